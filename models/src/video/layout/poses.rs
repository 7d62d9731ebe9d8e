//! Cameras by pose: images taken from the same place with the same lens are one camera.

use gradreel::{Error, ErrorKind, Result};

use super::MAX_CAMERAS;
use crate::vector::times;
use crate::video::matrix::Intrinsic;

/// Share by which two numbers of a pose may differ and still be the same, written with few digits.
const TOLERANCE: f64 = 1e-6;

/// Camera to world (OpenGL axes) and lens of an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub c2w: [[f64; 4]; 3],
    pub intrinsic: Intrinsic,
    pub size: Option<(usize, usize)>,
}

impl Pose {
    /// Whether both are the same camera.
    pub fn same(&self, other: &Pose) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= TOLERANCE * a.abs().max(1.0);
        let place = self.c2w.iter().flatten().zip(other.c2w.iter().flatten()).all(|(&a, &b)| near(a, b));
        let lens = self.intrinsic.iter().zip(&other.intrinsic).all(|(&a, &b)| near(a, b));
        place && lens && self.size == other.size
    }
}

/// The position of a pose in a list of different ones, where it is added if it is new.
///
/// # Errors
/// More poses than a clip has cameras.
pub(super) fn position(known: &mut Vec<Pose>, pose: Pose, list: &std::path::Path) -> Result<usize> {
    if let Some(at) = known.iter().position(|other| other.same(&pose)) {
        return Ok(at);
    }
    if known.len() == MAX_CAMERAS {
        return Err(moving(list, format!("more than {MAX_CAMERAS} different poses")));
    }
    known.push(pose);
    Ok(known.len() - 1)
}

/// The error for a list whose images have a pose of their own each.
pub(super) fn moving(list: &std::path::Path, found: String) -> Error {
    Error::new(ErrorKind::Input, "the camera moves")
        .at(list.display())
        .found(found)
        .wanted("cameras that stand still, with a frame at each time")
        .fix("film with several cameras that stand still; clips of one moving camera cannot be used")
}

/// Camera to world with OpenGL axes (y up, looking along −z) from world to camera with OpenCV's (y down, along z):
/// `x_camera = rotation x_world + translation`.
pub(super) fn from_opencv(rotation: &[[f64; 3]; 3], translation: [f64; 3]) -> [[f64; 4]; 3] {
    let back = std::array::from_fn(|i| [rotation[0][i], rotation[1][i], rotation[2][i]]);
    let centre = times(&back, translation).map(|x| -x);
    std::array::from_fn(|i| [back[i][0], -back[i][1], -back[i][2], centre[i]])
}
