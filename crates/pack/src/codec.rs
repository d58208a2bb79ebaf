//! The only file that names bincode: the header as bytes, and the tables of unfinished files.
//!
//! Fixed-width little-endian integers, u64 lengths, u32 enum codes, as `SPEC.md` describes. Decoding runs under a limit,
//! so that a hostile length cannot ask for more memory than a table of that size could need.

use bincode::config::{Configuration, Fixint, Limit, LittleEndian};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{Error, Result};

/// Most bytes of an encoded header.
pub const MAX_HEADER_BYTES: usize = 1 << 20;

fn config<const LIMIT: usize>() -> Configuration<LittleEndian, Fixint, Limit<LIMIT>> {
    bincode::config::standard().with_little_endian().with_fixed_int_encoding().with_limit::<LIMIT>()
}

/// Encodes a table; `LIMIT` is checked here because bincode enforces it only when decoding.
pub fn encode<T: Serialize, const LIMIT: usize>(table: &T, what: &'static str) -> Result<Vec<u8>> {
    let bytes = bincode::serde::encode_to_vec(table, config::<LIMIT>())
        .map_err(|error| Error::Parameter(format!("{what} cannot be encoded: {error}")))?;
    check_limit::<LIMIT>(bytes.len(), what)?;
    Ok(bytes)
}

/// Decodes a table and checks that it takes all of `bytes`.
pub fn decode<T: DeserializeOwned, const LIMIT: usize>(bytes: &[u8], what: &'static str) -> Result<T> {
    check_limit::<LIMIT>(bytes.len(), what)?;
    let (table, used) = bincode::serde::decode_from_slice(bytes, config::<LIMIT>())
        .map_err(|error| Error::Format(format!("{what} is damaged: {error}")))?;
    if used != bytes.len() {
        return Err(Error::Format(format!(
            "{what} is damaged: {} of its {} bytes mean nothing",
            bytes.len() - used,
            bytes.len()
        )));
    }
    Ok(table)
}

fn check_limit<const LIMIT: usize>(found: usize, what: &'static str) -> Result<()> {
    if found > LIMIT {
        return Err(Error::LimitsExceeded { what, found: found as u64, limit: LIMIT as u64 });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_is_fixed_width_little_endian() {
        let bytes = encode::<_, 100>(&("ab".to_owned(), 3_u32, Some(1_u8)), "table").expect("encodes");
        assert_eq!(bytes, [2, 0, 0, 0, 0, 0, 0, 0, b'a', b'b', 3, 0, 0, 0, 1, 1]);
    }

    #[test]
    fn hostile_lengths_and_trailing_bytes_are_refused() {
        let huge = [0xff, 0xff, 0xff, 0xff, 7, 0, 0, 0, 1];
        assert!(matches!(decode::<String, 100>(&huge, "table"), Err(Error::Format(_))));
        assert!(matches!(decode::<u8, 100>(&[1, 2], "table"), Err(Error::Format(_))));
        assert!(matches!(decode::<u8, 1>(&[1, 2], "table"), Err(Error::LimitsExceeded { .. })));
        assert!(matches!(encode::<_, 4>(&1_u64, "table"), Err(Error::LimitsExceeded { .. })));
    }
}
