//! Passes over folders of numbered pictures, which have no times of their own.

use std::path::Path;

use gradreel::Result;

use super::super::Wanted;
use super::area::{shrunk, within};
use super::limits::{Budget, check_size};
use super::pictures::{Decoded, Undated};
use super::{Info, Kind, Pass, Series, absent, lens, uneven};
use crate::video::image::Image;

/// What a folder says of itself.
pub(super) fn open(folder: &Path) -> Result<(Info, Kind)> {
    let series = Series::of(folder)?;
    let Some(first) = series.files.first() else { return Err(absent(folder, 0, Some(0))) };
    let first = Image::read_any(first)?;
    let size = (first.width, first.height);
    check_size(folder, size)?;
    let info = Info {
        size,
        stored: size,
        count: Some(series.files.len()),
        rate: None,
        capture_rate: None,
        unit: 0.0,
        few_colours: false,
        focal: lens::focal(&series),
        said: series.said.clone(),
    };
    Ok((info, Kind::Folder(series)))
}

/// The wanted pictures, none of which may be missing.
pub(super) fn pass(folder: &Path, series: &Series, pass: Pass) -> Result<Decoded> {
    let count = pass.decoded().saturating_sub(pass.first);
    let files = series.chosen(folder, Wanted { first: pass.first, count })?.to_vec();
    let folder = folder.to_path_buf();
    let mut budget = Budget::default();
    let mut size = None;
    let read = move |(k, file): (usize, std::path::PathBuf)| {
        check_size(&file, Image::frame_size(&file)?)?;
        let image = Image::read_any(&file)?;
        let found = (image.width, image.height);
        let wanted = *size.get_or_insert(found);
        if found != wanted {
            return Err(uneven(&folder, pass.first + k, found, wanted));
        }
        budget.spend(&folder, found)?;
        Ok(Undated { number: pass.first + k, seconds: None, image: shrunk(image, within(found, pass.longer)) })
    };
    Ok(Box::new(files.into_iter().enumerate().step_by(pass.every.max(1)).map(read)))
}
