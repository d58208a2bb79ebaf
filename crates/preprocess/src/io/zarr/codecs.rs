//! Compression of Zarr's chunks, unpacked with a limit.
//!
//! The codecs that come with the crate `zarrs` unpack whatever a chunk holds, or allocate what it claims; these here give
//! up beyond what a chunk of the array's metadata can have. They take the places of the crate's own, for reading only.

use std::any::Any;
use std::borrow::Cow;
use std::io::{self, Read};
use std::sync::{Arc, Once};

use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use zarrs::array::codec::api::{
    Codec, CodecError, CodecMetadataOptions, CodecRuntimePluginV2, CodecRuntimePluginV3, CodecTraits,
    PartialDecoderCapability, PartialEncoderCapability, RecommendedConcurrency, register_codec_v2, register_codec_v3,
};
use zarrs::array::{ArrayBytesRaw, BytesRepresentation, BytesToBytesCodecTraits, CodecOptions};
use zarrs::metadata::Configuration;
use zarrs::plugin::{ExtensionName, ZarrVersion};

use super::blosc;

/// How a chunk is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compression {
    Blosc,
    Gzip,
    Zlib,
    Zstandard,
}

impl Compression {
    const ALL: [Self; 4] = [Self::Blosc, Self::Gzip, Self::Zlib, Self::Zstandard];

    /// Its name in the metadata of Zarr 2 and 3.
    fn name(self) -> &'static str {
        match self {
            Self::Blosc => "blosc",
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
            Self::Zstandard => "zstd",
        }
    }

    /// Whether it is meant by a name, which may be that of Python's package numcodecs.
    fn is_named(self, name: &str) -> bool {
        name.strip_prefix("numcodecs.").unwrap_or(name) == self.name()
    }

    /// Unpacks at most `limit` bytes.
    fn unpack(self, packed: &[u8], limit: u64) -> Result<Vec<u8>, CodecError> {
        let read = |stream: &mut dyn Read| -> Result<Vec<u8>, CodecError> {
            let mut unpacked = Vec::new();
            stream
                .take(limit.saturating_add(1))
                .read_to_end(&mut unpacked)
                .map_err(|error| CodecError::Other(format!("expected a whole compressed chunk, found: {error}")))?;
            if unpacked.len() as u64 > limit {
                return Err(CodecError::Other(format!("expected a chunk of at most {limit} bytes, found more in it")));
            }
            Ok(unpacked)
        };
        match self {
            Self::Blosc => blosc::unpack(packed, limit).map_err(CodecError::Other),
            Self::Gzip => read(&mut MultiGzDecoder::new(packed)),
            Self::Zlib => read(&mut ZlibDecoder::new(packed)),
            Self::Zstandard => read(&mut zstd::Decoder::with_buffer(packed).map_err(io_error)?),
        }
    }
}

fn io_error(error: io::Error) -> CodecError {
    CodecError::Other(error.to_string())
}

/// Lets `zarrs` unpack chunks with the codecs of this file.
pub fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        for compression in Compression::ALL {
            let is_named = move |name: &str| compression.is_named(name);
            let codec = move || Ok(Codec::BytesToBytes(Arc::new(BoundedCodec { compression })));
            register_codec_v2(CodecRuntimePluginV2::new(is_named, move |_| codec()));
            register_codec_v3(CodecRuntimePluginV3::new(is_named, move |_| codec()));
        }
    });
}

#[derive(Debug)]
struct BoundedCodec {
    compression: Compression,
}

impl ExtensionName for BoundedCodec {
    fn name(&self, _: ZarrVersion) -> Option<Cow<'static, str>> {
        Some(self.compression.name().into())
    }
}

impl CodecTraits for BoundedCodec {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn configuration(&self, _: ZarrVersion, _: &CodecMetadataOptions) -> Option<Configuration> {
        None
    }

    fn partial_decoder_capability(&self) -> PartialDecoderCapability {
        PartialDecoderCapability { partial_read: false, partial_decode: false }
    }

    fn partial_encoder_capability(&self) -> PartialEncoderCapability {
        PartialEncoderCapability { partial_encode: false }
    }
}

impl BytesToBytesCodecTraits for BoundedCodec {
    fn into_dyn(self: Arc<Self>) -> Arc<dyn BytesToBytesCodecTraits> {
        self
    }

    fn recommended_concurrency(&self, _: &BytesRepresentation) -> Result<RecommendedConcurrency, CodecError> {
        Ok(RecommendedConcurrency::new_maximum(1))
    }

    fn encoded_representation(&self, decoded: &BytesRepresentation) -> BytesRepresentation {
        // What none of the methods makes of incompressible bytes.
        let bound = |size: u64| BytesRepresentation::BoundedSize(size.saturating_mul(2).saturating_add(1 << 12));
        decoded.size().map_or(BytesRepresentation::UnboundedSize, bound)
    }

    fn encode<'a>(&self, _: ArrayBytesRaw<'a>, _: &CodecOptions) -> Result<ArrayBytesRaw<'a>, CodecError> {
        Err(CodecError::Other(format!("{:?} is only read here", self.compression)))
    }

    fn decode<'a>(
        &self,
        encoded: ArrayBytesRaw<'a>,
        decoded: &BytesRepresentation,
        _: &CodecOptions,
    ) -> Result<ArrayBytesRaw<'a>, CodecError> {
        let limit =
            decoded.size().ok_or_else(|| CodecError::Other("expected chunks of a known size, found others".into()))?;
        self.compression.unpack(&encoded, limit).map(Cow::Owned)
    }
}
