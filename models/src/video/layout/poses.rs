//! Cameras by pose: images with equal pose and intrinsics belong to one camera.

use gradreel::{Error, ErrorKind, Result};

use super::MAX_CAMERAS;
use crate::vector::times;
use crate::video::matrix::Intrinsic;

/// Relative tolerance between two numbers of a pose, which allows for few written digits.
const TOLERANCE: f64 = 1e-6;

/// Pose (camera to world, OpenGL axes) and intrinsics of an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub c2w: [[f64; 4]; 3],
    pub intrinsic: Intrinsic,
    pub size: Option<(usize, usize)>,
}

impl Pose {
    /// Whether both belong to the same camera.
    pub fn same(&self, other: &Pose) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= TOLERANCE * a.abs().max(1.0);
        let place = self.c2w.iter().flatten().zip(other.c2w.iter().flatten()).all(|(&a, &b)| near(a, b));
        let lens = self.intrinsic.iter().zip(&other.intrinsic).all(|(&a, &b)| near(a, b));
        place && lens && self.size == other.size
    }
}

/// The index of a pose in a list of distinct poses; a new pose is appended.
///
/// # Errors
/// [`ErrorKind::Input`] if there are more poses than a clip may have cameras.
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

/// The error for a list in which every image has its own pose.
pub(super) fn moving(list: &std::path::Path, found: String) -> Error {
    Error::new(ErrorKind::Input, "the camera moves")
        .at(list.display())
        .found(found)
        .wanted("cameras that stand still, with a frame at each time")
        .fix("film with several cameras that stand still; clips of one moving camera cannot be used")
}

/// Converts world to camera with OpenCV axes (y down, looking along z), `x_camera = rotation x_world + translation`,
/// to camera to world with OpenGL axes (y up, looking along −z).
pub(super) fn from_opencv(rotation: &[[f64; 3]; 3], translation: [f64; 3]) -> [[f64; 4]; 3] {
    let back = std::array::from_fn(|i| [rotation[0][i], rotation[1][i], rotation[2][i]]);
    let centre = times(&back, translation).map(|x| -x);
    std::array::from_fn(|i| [back[i][0], -back[i][1], -back[i][2], centre[i]])
}
