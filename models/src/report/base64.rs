//! Base64 (RFC 4648, section 4), for embedding pictures and data in a page.

const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Encodes bytes as base64 with padding: four characters for every three bytes, with `=` completing the last four.
pub fn encode(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let byte = |i: usize| u32::from(chunk.get(i).copied().unwrap_or(0));
        let word = byte(0) << 16 | byte(1) << 8 | byte(2);
        for place in 0..4 {
            let sextet = (word >> (18 - 6 * place)) & 63;
            text.push(if place <= chunk.len() { char::from(ALPHABET[sextet as usize]) } else { '=' });
        }
    }
    text
}

/// Decodes base64 text; padding is optional. `None` for any other text.
pub fn decode(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for chunk in text.chunks(4) {
        let mut word = 0;
        for &letter in chunk {
            let sextet = ALPHABET.iter().position(|known| *known == letter)?;
            word = word << 6 | sextet as u32;
        }
        // surplus bits of an incomplete last byte are dropped
        let (whole, bits) = (6 * chunk.len() / 8, 6 * chunk.len());
        if whole == 0 {
            return None;
        }
        bytes.extend((1..=whole).map(|byte| (word >> (bits - 8 * byte)) as u8));
    }
    Some(bytes)
}
