//! Folders of numbered pictures.

use std::path::{Path, PathBuf};

use gradreel::{Error, Result};

use super::{Decoded, Wanted, check_bytes};
use crate::video::image::Image;

/// Pictures of a folder in the order of the numbers in their names, then of the names.
pub(super) fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, "list the folder", &e))?;
    let mut pictures: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| matches!(super::ending(path).as_str(), "png" | "jpg" | "jpeg") && path.is_file())
        .collect();
    pictures.sort_by_cached_key(|path| {
        let name = path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let digits: String =
            name.chars().rev().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit).collect();
        let number: String = digits.chars().rev().collect();
        (number.parse::<u64>().unwrap_or(u64::MAX), name)
    });
    Ok(pictures)
}

/// Reads the wanted pictures, which do not say how fast they follow each other.
pub(super) fn read(folder: &Path, wanted: Wanted) -> Result<Decoded> {
    let mut images: Vec<Image> = Vec::new();
    for path in list(folder)?.into_iter().skip(wanted.first).take(wanted.count) {
        let (width, height) = Image::frame_size(&path)?;
        check_bytes(&path, width, height, images.len() + 1)?;
        images.push(Image::read_frame(&path)?);
    }
    Ok(Decoded { images, frames_per_s: None, few_colours: false })
}
