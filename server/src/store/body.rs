//! Results as stored: JSON, compressed where it pays.

use std::io::{self, BufWriter, Write};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::StoreError;

/// From this size on a body is compressed.
const LARGE: usize = 4096;
/// Compression level: a training's weights are noise, more effort finds nothing.
const LEVEL: i32 = 3;
/// What compressed bodies begin with, and no JSON does.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// How much JSON is gathered before it is compressed, bytes.
const PIECE: usize = 64 << 10;

/// A body as it goes into the store.
#[derive(Debug)]
pub(crate) struct Packed {
    /// JSON, compressed where large.
    pub(crate) body: Vec<u8>,
    /// blake3 of the JSON.
    pub(crate) digest: [u8; 32],
}

/// Packs a value whose JSON is small as a rule.
///
/// # Errors
/// When it cannot be written as JSON, or compressed.
pub(crate) fn pack(value: &impl Serialize) -> io::Result<Packed> {
    let json = serde_json::to_vec(value)?;
    let digest = *blake3::hash(&json).as_bytes();
    let body = if json.len() < LARGE { json } else { zstd::encode_all(json.as_slice(), LEVEL)? };
    Ok(Packed { body, digest })
}

/// [`pack`] of a value whose JSON may be large: it is compressed while it is written, and never there as a whole.
///
/// # Errors
/// As [`pack`].
pub(crate) fn pack_large(value: &impl Serialize) -> io::Result<Packed> {
    let (hasher, encoder) = (blake3::Hasher::new(), zstd::Encoder::new(Vec::new(), LEVEL)?);
    let mut pieces = BufWriter::with_capacity(PIECE, Hashing { hasher, inner: encoder });
    serde_json::to_writer(&mut pieces, value)?;
    let Hashing { hasher, inner } = pieces.into_inner().map_err(io::IntoInnerError::into_error)?;
    Ok(Packed { body: inner.finish()?, digest: *hasher.finalize().as_bytes() })
}

/// Hashes what it hands on.
struct Hashing<W> {
    hasher: blake3::Hasher,
    inner: W,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, piece: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(piece)?;
        self.hasher.update(&piece[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// The JSON of a stored body.
pub(crate) fn unpack(body: Vec<u8>) -> Result<Vec<u8>, StoreError> {
    if !body.starts_with(&ZSTD_MAGIC) {
        return Ok(body);
    }
    zstd::decode_all(body.as_slice()).map_err(|e| StoreError::Corrupt(e.to_string()))
}

/// What a stored body says.
pub(crate) fn parse<T: DeserializeOwned>(body: Vec<u8>) -> Result<T, StoreError> {
    from_json(&unpack(body)?)
}

/// [`parse`] of a body which may be large: not on the threads which serve.
pub(super) async fn parse_apart<T: DeserializeOwned + Send + 'static>(body: Vec<u8>) -> Result<T, StoreError> {
    if body.len() < LARGE {
        return parse(body);
    }
    tokio::task::spawn_blocking(move || parse(body)).await.map_err(|_| StoreError::Panicked)?
}

/// What stored JSON says.
pub(super) fn from_json<T: DeserializeOwned>(json: &[u8]) -> Result<T, StoreError> {
    serde_json::from_slice(json).map_err(|e| StoreError::Corrupt(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_and_large_bodies_come_back() {
        for length in [0, 3, 100_000] {
            let value = vec![1.5_f64; length];
            let json = serde_json::to_vec(&value).expect("numbers");
            let (packed, large) = (pack(&value).expect("packs"), pack_large(&value).expect("packs"));
            assert_eq!(packed.body.len() < json.len(), length > 100);
            assert!(large.body.starts_with(&ZSTD_MAGIC));
            for Packed { body, digest } in [packed, large] {
                assert_eq!(digest, *blake3::hash(&json).as_bytes());
                assert_eq!(unpack(body).expect("unpacks"), json);
            }
        }
    }
}
