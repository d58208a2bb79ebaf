//! Attributes of XML elements: of VTK's files and of OME's descriptions.

use std::path::Path;

use quick_xml::events::BytesStart;
use quick_xml::{Decoder, XmlVersion};

use super::header::Fields;
use crate::{Error, Result};

/// The attributes of an element. Entities are resolved if XML itself defines them; none that a document could define.
///
/// # Errors
/// [`Error::Format`], naming `path`, for broken or repeated attributes.
pub(super) fn attributes<'a>(path: &'a Path, element: &BytesStart<'_>, decoder: Decoder) -> Result<Fields<'a>> {
    let broken = |error: &dyn std::fmt::Display| {
        let name = String::from_utf8_lossy(element.name().as_ref()).into_owned();
        Error::format(path, format!("expected the attributes of the XML element {name}, found: {error}"))
    };
    let mut fields = Fields::new(path);
    for attribute in element.attributes() {
        let attribute = attribute.map_err(|error| broken(&error))?;
        let name = decoder.decode(attribute.key.as_ref()).map_err(|error| broken(&error))?;
        let value = attribute.decoded_and_normalized_value(XmlVersion::Implicit1_0, decoder);
        fields.insert(&name, &value.map_err(|error| broken(&error))?)?;
    }
    Ok(fields)
}
