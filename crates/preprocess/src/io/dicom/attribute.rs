//! The attributes of DICOM that say what a volume is: <https://dicom.nema.org/medical/dicom/current/output/chtml/part06/chapter_6.html>.

/// An attribute that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Attribute {
    /// Group and element: `0x0028_0010` is (0028,0010).
    pub tag: u32,
    /// The standard's keyword.
    pub name: &'static str,
}

macro_rules! attributes {
    ($($constant:ident = $tag:literal, $name:literal;)*) => {
        $(pub(super) const $constant: Attribute = Attribute { tag: $tag, name: $name };)*

        /// Whether a value is of interest; sequences are looked into.
        pub(super) fn is_read(tag: u32) -> bool {
            [$($tag),*].contains(&tag)
        }
    };
}

attributes! {
    TRANSFER_SYNTAX = 0x0002_0010, "TransferSyntaxUID";
    MODALITY = 0x0008_0060, "Modality";
    SERIES_DESCRIPTION = 0x0008_103e, "SeriesDescription";
    SERIES_UID = 0x0020_000e, "SeriesInstanceUID";
    SERIES_NUMBER = 0x0020_0011, "SeriesNumber";
    POSITION = 0x0020_0032, "ImagePositionPatient";
    ORIENTATION = 0x0020_0037, "ImageOrientationPatient";
    POSITION_SEQUENCE = 0x0020_9113, "PlanePositionSequence";
    ORIENTATION_SEQUENCE = 0x0020_9116, "PlaneOrientationSequence";
    SAMPLES_PER_PIXEL = 0x0028_0002, "SamplesPerPixel";
    PHOTOMETRIC = 0x0028_0004, "PhotometricInterpretation";
    FRAMES = 0x0028_0008, "NumberOfFrames";
    ROWS = 0x0028_0010, "Rows";
    COLUMNS = 0x0028_0011, "Columns";
    PIXEL_SPACING = 0x0028_0030, "PixelSpacing";
    BITS_ALLOCATED = 0x0028_0100, "BitsAllocated";
    BITS_STORED = 0x0028_0101, "BitsStored";
    HIGH_BIT = 0x0028_0102, "HighBit";
    PIXEL_REPRESENTATION = 0x0028_0103, "PixelRepresentation";
    PADDING = 0x0028_0120, "PixelPaddingValue";
    PADDING_LIMIT = 0x0028_0121, "PixelPaddingRangeLimit";
    INTERCEPT = 0x0028_1052, "RescaleIntercept";
    SLOPE = 0x0028_1053, "RescaleSlope";
    MODALITY_LUT = 0x0028_3000, "ModalityLUTSequence";
    MEASURES_SEQUENCE = 0x0028_9110, "PixelMeasuresSequence";
    RESCALE_SEQUENCE = 0x0028_9145, "PixelValueTransformationSequence";
    SHARED_GROUPS = 0x5200_9229, "SharedFunctionalGroupsSequence";
    FRAME_GROUPS = 0x5200_9230, "PerFrameFunctionalGroupsSequence";
    PIXEL_DATA = 0x7fe0_0010, "PixelData";
}

/// Pixels as floating-point numbers, which some parametric maps have.
pub(super) const FLOAT_PIXEL_DATA: [u32; 2] = [0x7fe0_0008, 0x7fe0_0009];
/// What begins an item of a sequence or of compressed pixels, what ends one, and what ends the sequence.
pub(super) const ITEM: u32 = 0xfffe_e000;
pub(super) const ITEM_END: u32 = 0xfffe_e00d;
pub(super) const SEQUENCE_END: u32 = 0xfffe_e0dd;
