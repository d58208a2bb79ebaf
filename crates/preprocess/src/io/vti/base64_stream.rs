//! Base64 text as a stream of bytes.

use std::io::{self, BufRead, Read};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Characters that are decoded at a time: whole groups of four.
const TEXT_BYTES: usize = 1 << 14;

/// The bytes that base64 text encodes, up to the next `<` or the end. Padding may also stand inside: writers encode a
/// header and what follows it one by one.
#[derive(Debug)]
pub struct Base64Stream<R> {
    text: R,
    /// Characters to decode next.
    groups: Vec<u8>,
    decoded: Vec<u8>,
    /// Bytes of `decoded` that were given out.
    given: usize,
}

impl<R: BufRead> Base64Stream<R> {
    pub fn new(text: R) -> Self {
        Self { text, groups: Vec::new(), decoded: Vec::new(), given: 0 }
    }

    /// Takes in characters, blanks left out, until there is a whole buffer or no more.
    fn gather(&mut self) -> io::Result<()> {
        while self.groups.len() < TEXT_BYTES {
            let bytes = self.text.fill_buf()?;
            let end = bytes.iter().position(|&byte| byte == b'<');
            let room = TEXT_BYTES - self.groups.len();
            let taken = &bytes[..end.unwrap_or(bytes.len()).min(room)];
            let count = taken.len();
            if count == 0 {
                break;
            }
            self.groups.extend(taken.iter().filter(|byte| !byte.is_ascii_whitespace()));
            self.text.consume(count);
        }
        Ok(())
    }

    /// Decodes a whole buffer, from padding to padding.
    fn decode(&mut self) -> io::Result<()> {
        self.gather()?;
        self.decoded.clear();
        self.given = 0;
        let mut rest = self.groups.as_slice();
        while !rest.is_empty() {
            let padding = rest.iter().position(|&character| character == b'=');
            let end = padding.map_or(rest.len(), |at| at / 4 * 4 + 4);
            let groups = rest.get(..end).filter(|groups| groups.len() % 4 == 0).ok_or(io::ErrorKind::UnexpectedEof)?;
            let decoded = STANDARD.decode_vec(groups, &mut self.decoded);
            decoded.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
            rest = &rest[end..];
        }
        self.groups.clear();
        Ok(())
    }
}

impl<R: BufRead> Read for Base64Stream<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.given == self.decoded.len() {
            self.decode()?;
        }
        let count = (&self.decoded[self.given..]).read(buffer)?;
        self.given += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(text: &str) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        Base64Stream::new(text.as_bytes()).read_to_end(&mut bytes).map(|_| bytes)
    }

    #[test]
    fn blanks_and_padding_may_stand_inside() {
        for (text, expected) in [
            ("", "".as_bytes()),
            ("YWJj", b"abc"),
            (" YW\nJj\t", b"abc"),
            ("YQ==YmM=ZGVm", b"abcdef"),
            ("YWJj</DataArray>", b"abc"),
        ] {
            assert_eq!(decode(text).expect(text), expected, "{text}");
        }
        let long = vec![7; 5 * TEXT_BYTES + 1];
        assert_eq!(decode(&STANDARD.encode(&long)).expect("long"), long);
    }

    #[test]
    fn what_is_no_base64_is_refused() {
        for text in ["Y", "YQ", "YQ=", "Y===", "Y*Jj", "YR==", "=YQ="] {
            assert!(decode(text).is_err(), "{text}");
        }
    }
}
