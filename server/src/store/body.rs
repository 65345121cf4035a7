//! Results as stored: JSON, compressed where it pays.

use serde::de::DeserializeOwned;

use super::StoreError;

/// From this size on a body is compressed.
const LARGE: usize = 4096;
/// Compression level: a training's weights are noise, more effort finds nothing.
const LEVEL: i32 = 3;
/// What compressed bodies begin with, and no JSON does.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// A body as it goes into the store.
pub(crate) fn pack(json: Vec<u8>) -> Result<Vec<u8>, std::io::Error> {
    if json.len() < LARGE { Ok(json) } else { zstd::encode_all(json.as_slice(), LEVEL) }
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
        for length in [3, 100_000] {
            let json = serde_json::to_vec(&vec![1.5_f64; length]).expect("numbers");
            let packed = pack(json.clone()).expect("packs");
            assert_eq!(packed.len() < json.len(), length > 100);
            assert_eq!(unpack(packed).expect("unpacks"), json);
        }
    }
}
