//! The markup of VTK's XML files: what they say, and where their numbers are.
//!
//! Numbers are passed over, so that no more than the markup is in memory. What an appended section holds need not be text:
//! reading ends where it begins.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::super::header::Fields;
use super::super::{payload, xml};
use crate::{Error, Result};

/// Longest markup that is read, without the numbers inside it.
const MAX_MARKUP_BYTES: usize = 1 << 20;

/// What a file says.
pub struct Document<'a> {
    /// Attributes of `VTKFile`.
    pub file: Fields<'a>,
    /// Attributes of `ImageData`.
    pub image: Fields<'a>,
    /// Attributes of the one `Piece`.
    pub piece: Fields<'a>,
    /// Arrays at the points.
    pub points: Arrays<'a>,
    /// Arrays in the cells between them.
    pub cells: Arrays<'a>,
    pub appended: Option<Appended>,
}

/// The arrays of one kind.
#[derive(Default)]
pub struct Arrays<'a> {
    /// The name of the active scalars.
    pub scalars: Option<String>,
    pub all: Vec<Array<'a>>,
}

/// An array: the attributes of `DataArray`, and where the text inside begins.
pub struct Array<'a> {
    pub fields: Fields<'a>,
    pub text_offset: u64,
}

impl Array<'_> {
    pub fn name(&self) -> &str {
        self.fields.get(&["Name"]).unwrap_or_default()
    }
}

/// Where the appended section begins, behind its underscore.
pub struct Appended {
    pub encoding: String,
    pub offset: u64,
}

/// Which arrays are being read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    Points,
    Cells,
    Other,
}

impl<'a> Document<'a> {
    /// Reads the markup of the file at `path`.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] for what is no XML of VTK's, other data sets than image data, or several pieces.
    pub fn read(path: &'a Path) -> Result<Self> {
        let (file, _) = payload::open(path)?;
        let metered = Metered { inner: BufReader::new(file), left: MAX_MARKUP_BYTES };
        let mut markup = Markup { path, reader: Reader::from_reader(metered), buffer: Vec::new() };
        let mut builder = Builder::new(path);
        loop {
            markup.buffer.clear();
            let decoder = markup.reader.decoder();
            let event = markup.reader.read_event_into(&mut markup.buffer);
            let position = markup.reader.buffer_position();
            match event {
                Ok(Event::Start(element)) => match builder.open(&element, decoder, position)? {
                    Inside::Markup => {}
                    Inside::Numbers => markup.skip_text()?,
                    Inside::Appended => {
                        let offset = markup.appended_offset()?;
                        builder.appended_at(offset);
                        break;
                    }
                },
                // An empty element has no inside, and no end that would be told.
                Ok(Event::Empty(element)) => {
                    builder.open(&element, decoder, position)?;
                    builder.close(element.name().as_ref());
                }
                Ok(Event::End(element)) => builder.close(element.name().as_ref()),
                Ok(Event::DocType(_)) => {
                    return Err(Error::format(path, "expected VTK's XML, found a document type declaration in it"));
                }
                Ok(Event::Eof) => {
                    builder.expect_end()?;
                    break;
                }
                Ok(_) => {}
                Err(error) => {
                    let message = format!("expected VTK's XML, found at byte {position}: {error}");
                    return Err(Error::format(path, message));
                }
            }
        }
        builder.document()
    }
}

/// What an element has inside.
enum Inside {
    Markup,
    Numbers,
    Appended,
}

/// The parts of a document that were met so far.
struct Builder<'a> {
    path: &'a Path,
    file: Option<Fields<'a>>,
    image: Option<Fields<'a>>,
    piece: Option<Fields<'a>>,
    points: Arrays<'a>,
    cells: Arrays<'a>,
    appended: Option<Appended>,
    section: Section,
    is_closed: bool,
}

impl<'a> Builder<'a> {
    fn new(path: &'a Path) -> Self {
        let (points, cells) = (Arrays::default(), Arrays::default());
        let (file, image, piece, appended) = (None, None, None, None);
        Self { path, file, image, piece, points, cells, appended, section: Section::Other, is_closed: false }
    }

    fn fail(&self, message: impl Into<String>) -> Error {
        Error::format(self.path, message)
    }

    fn open(&mut self, element: &BytesStart<'_>, decoder: quick_xml::Decoder, position: u64) -> Result<Inside> {
        let fields = || xml::attributes(self.path, element, decoder);
        match element.name().as_ref() {
            b"VTKFile" => {
                let fields = fields()?;
                match fields.required("type")? {
                    "ImageData" => self.file = Some(fields),
                    other => {
                        let expected = "ImageData, a regular grid (resample others first, for example with ParaView)";
                        return Err(fields.unexpected("type", expected, other));
                    }
                }
            }
            b"ImageData" => self.image = Some(fields()?),
            b"Piece" if self.piece.is_some() => {
                return Err(self.fail("expected one piece, found several: join them first, for example with ParaView"));
            }
            b"Piece" => self.piece = Some(fields()?),
            b"PointData" => {
                self.points.scalars = fields()?.get(&["Scalars"]).map(str::to_owned);
                self.section = Section::Points;
            }
            b"CellData" => {
                self.cells.scalars = fields()?.get(&["Scalars"]).map(str::to_owned);
                self.section = Section::Cells;
            }
            b"DataArray" => {
                let array = Array { fields: fields()?, text_offset: position };
                match self.section {
                    Section::Points => self.points.all.push(array),
                    Section::Cells => self.cells.all.push(array),
                    Section::Other => {}
                }
                return Ok(Inside::Numbers);
            }
            b"Array" => return Ok(Inside::Numbers),
            b"AppendedData" => {
                let encoding = fields()?.required("encoding")?.to_owned();
                self.appended = Some(Appended { encoding, offset: position });
                return Ok(Inside::Appended);
            }
            _ => {}
        }
        Ok(Inside::Markup)
    }

    fn close(&mut self, name: &[u8]) {
        if matches!(name, b"PointData" | b"CellData") {
            self.section = Section::Other;
        }
        self.is_closed |= name == b"VTKFile";
    }

    fn expect_end(&self) -> Result<()> {
        if self.file.is_some() && !self.is_closed {
            return Err(self.fail("expected the end of the XML element VTKFile, found the file's end before it"));
        }
        Ok(())
    }

    fn appended_at(&mut self, offset: u64) {
        if let Some(appended) = &mut self.appended {
            appended.offset = offset;
        }
    }

    fn document(self) -> Result<Document<'a>> {
        let missing = |name: &str| Error::format(self.path, format!("expected an XML element {name}, found none"));
        Ok(Document {
            file: self.file.ok_or_else(|| missing("VTKFile"))?,
            image: self.image.ok_or_else(|| missing("ImageData"))?,
            piece: self.piece.ok_or_else(|| missing("Piece"))?,
            points: self.points,
            cells: self.cells,
            appended: self.appended,
        })
    }
}

/// The file as events and, between them, as bytes.
struct Markup<'a> {
    path: &'a Path,
    reader: Reader<Metered<BufReader<File>>>,
    buffer: Vec<u8>,
}

impl Markup<'_> {
    /// Passes over text up to the next markup, however long it is.
    fn skip_text(&mut self) -> Result<()> {
        let left = std::mem::replace(&mut self.reader.get_mut().left, usize::MAX);
        let mut stream = self.reader.stream();
        loop {
            let bytes = stream.fill_buf().map_err(Error::io(self.path))?;
            let length = bytes.len();
            let end = bytes.iter().position(|&byte| byte == b'<');
            stream.consume(end.unwrap_or(length));
            if end.is_some() || length == 0 {
                break;
            }
        }
        self.reader.get_mut().left = left;
        Ok(())
    }

    /// Where appended data begin: behind an underscore, before which there may be blanks.
    fn appended_offset(&mut self) -> Result<u64> {
        let mut stream = self.reader.stream();
        let mut byte = [0];
        loop {
            match stream.read(&mut byte) {
                Ok(1) if byte[0].is_ascii_whitespace() => {}
                Ok(1) if byte[0] == b'_' => return Ok(stream.offset()),
                Ok(_) => {
                    let message =
                        format!("expected the appended data behind an underscore, found byte {:#04x}", byte[0]);
                    return Err(Error::format(self.path, message));
                }
                Err(error) => return Err(Error::io(self.path)(error)),
            }
        }
    }
}

/// A reader that ends with an error behind a number of bytes.
struct Metered<R> {
    inner: R,
    left: usize,
}

impl<R: BufRead> BufRead for Metered<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.left == 0 {
            return Err(io::Error::other(format!("more than {MAX_MARKUP_BYTES} bytes of markup")));
        }
        let bytes = self.inner.fill_buf()?;
        Ok(&bytes[..bytes.len().min(self.left)])
    }

    fn consume(&mut self, count: usize) {
        self.left -= count;
        self.inner.consume(count);
    }
}

impl<R: BufRead> Read for Metered<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}
