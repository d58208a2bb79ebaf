//! How a DICOM file's attributes and pixels are encoded.

/// How pixels are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    /// Not at all.
    Native,
    /// Runs of bytes, plane by plane.
    Rle,
    /// JPEG, lossy or lossless, as far as it is decoded here.
    Jpeg,
    /// Known by name only.
    Unread(&'static str),
}

/// One transfer syntax.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TransferSyntax {
    /// Whether attributes carry the kind of their value.
    pub explicit: bool,
    pub big_endian: bool,
    pub codec: Codec,
}

/// Those in use: <https://dicom.nema.org/medical/dicom/current/output/chtml/part06/chapter_A.html>.
const KNOWN: [(&str, Codec); 24] = [
    ("1.2.840.10008.1.2", Codec::Native),
    ("1.2.840.10008.1.2.1", Codec::Native),
    ("1.2.840.10008.1.2.2", Codec::Native),
    ("1.2.840.10008.1.2.5", Codec::Rle),
    ("1.2.840.10008.1.2.4.50", Codec::Jpeg),
    ("1.2.840.10008.1.2.4.51", Codec::Jpeg),
    ("1.2.840.10008.1.2.4.57", Codec::Jpeg),
    ("1.2.840.10008.1.2.4.70", Codec::Jpeg),
    ("1.2.840.10008.1.2.1.98", Codec::Unread("encapsulated uncompressed")),
    ("1.2.840.10008.1.2.1.99", Codec::Unread("deflated")),
    ("1.2.840.10008.1.2.4.80", Codec::Unread("JPEG-LS lossless")),
    ("1.2.840.10008.1.2.4.81", Codec::Unread("JPEG-LS near-lossless")),
    ("1.2.840.10008.1.2.4.90", Codec::Unread("JPEG 2000 lossless")),
    ("1.2.840.10008.1.2.4.91", Codec::Unread("JPEG 2000")),
    ("1.2.840.10008.1.2.4.92", Codec::Unread("JPEG 2000 multi-component lossless")),
    ("1.2.840.10008.1.2.4.93", Codec::Unread("JPEG 2000 multi-component")),
    ("1.2.840.10008.1.2.4.100", Codec::Unread("MPEG-2")),
    ("1.2.840.10008.1.2.4.102", Codec::Unread("MPEG-4")),
    ("1.2.840.10008.1.2.4.110", Codec::Unread("JPEG XL lossless")),
    ("1.2.840.10008.1.2.4.111", Codec::Unread("JPEG XL of a JPEG")),
    ("1.2.840.10008.1.2.4.112", Codec::Unread("JPEG XL")),
    ("1.2.840.10008.1.2.4.201", Codec::Unread("high-throughput JPEG 2000 lossless")),
    ("1.2.840.10008.1.2.4.202", Codec::Unread("high-throughput JPEG 2000 lossless with levels")),
    ("1.2.840.10008.1.2.4.203", Codec::Unread("high-throughput JPEG 2000")),
];

impl TransferSyntax {
    /// How the attributes in front of all others, those about the file itself, are encoded.
    pub const FILE_META: Self = Self { explicit: true, big_endian: false, codec: Codec::Native };

    /// The syntax that `uid` names.
    pub fn new(uid: &str) -> Self {
        let known = KNOWN.iter().find(|(known, _)| *known == uid);
        Self {
            explicit: uid != "1.2.840.10008.1.2",
            big_endian: uid == "1.2.840.10008.1.2.2",
            codec: known.map_or(Codec::Unread("unknown"), |(_, codec)| *codec),
        }
    }
}

/// Why the pixels of a transfer syntax cannot be read, and what to do about it.
pub(super) fn refusal(uid: &str, name: &str) -> String {
    format!(
        "expected pixels that are uncompressed or packed as RLE or JPEG, found the transfer syntax {uid} ({name}), which is not \
         read: unpack the files first, for example with `gdcmconv --raw IN OUT`"
    )
}
