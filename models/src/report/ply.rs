//! PLY: particles as a point cloud for mesh viewers.
//!
//! Binary little-endian PLY 1.0: three `float` coordinates in metres with y up, then, if given, three `uchar` colours.
//! Format: Greg Turk, *The PLY Polygon File Format*, 1994.

use gradreel::{Error, ErrorKind, Result};

/// Encodes a point cloud: `positions` \[m\], y up, and either no colours or one sRGB colour per position.
///
/// # Errors
///
/// If a coordinate is NaN or infinite; the error names the particle.
///
/// # Panics
///
/// If the numbers of colours and positions differ.
#[track_caller]
pub fn ply(positions: &[[f32; 3]], colours: Option<&[[u8; 3]]>) -> Result<Vec<u8>> {
    if let Some(colours) = colours {
        assert_eq!(colours.len(), positions.len(), "ply: {} colours for {} points", colours.len(), positions.len());
    }
    if let Some((index, position)) = positions.iter().enumerate().find(|(_, p)| !p.iter().all(|x| x.is_finite())) {
        return Err(Error::new(ErrorKind::NonFinite, "a particle to be written has no place")
            .at(format!("particle {index}"))
            .found(format!("position {position:?}"))
            .wanted("three finite coordinates in metres"));
    }
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    header += "comment unit metre\ncomment axes right-handed, y up\n";
    if colours.is_some() {
        header += "comment colours sRGB\n";
    }
    header += &format!("element vertex {}\n", positions.len());
    header += "property float x\nproperty float y\nproperty float z\n";
    if colours.is_some() {
        header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    }
    header += "end_header\n";

    let bytes_per_point = if colours.is_some() { 15 } else { 12 };
    let mut bytes = Vec::with_capacity(header.len() + bytes_per_point * positions.len());
    bytes.extend_from_slice(header.as_bytes());
    for (index, position) in positions.iter().enumerate() {
        bytes.extend(position.iter().flat_map(|x| x.to_le_bytes()));
        if let Some(colours) = colours {
            bytes.extend_from_slice(&colours[index]);
        }
    }
    Ok(bytes)
}
