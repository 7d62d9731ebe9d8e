//! How high the ground is, when nobody said: where the object came down.

use gradreel::{Error, ErrorKind, Result};

use crate::field::{bounding_sphere, hull};
use crate::identify::Run;
use crate::identify::reconstruct::half_of_imagined;
use crate::video::Clip;

/// Voxels across half of the object.
const FINENESS: f64 = 40.0;

/// The lowest point \[m\] of what all silhouettes of a frame leave room for, in whichever frame that is lowest; `None` where no frame
/// shows the object.
///
/// A visual hull is never smaller than the object: the height is at most a few millimetres too low, where a camera looks along the ground, and more
/// where all look down.
pub(crate) fn lowest_point(clip: &Clip) -> Option<f64> {
    let lowest = |frame: usize| {
        let sphere = bounding_sphere(clip, frame).ok()?;
        let spacing = sphere.radius / FINENESS;
        let hull = hull(clip, frame, &sphere, spacing, 0.5, half_of_imagined(clip)).ok()?;
        let [_, rows, columns] = hull.lattice.dims;
        let row = |flat: &u32| *flat as usize / columns % rows;
        let first = hull.voxels.iter().map(row).min()?;
        Some(hull.lattice.origin[1] + (first as f64 - 0.5) * spacing)
    };
    (0..clip.frame_count()).filter_map(lowest).reduce(f64::min)
}

/// How far below the ground an object may be seen before it is said \[grid spacings\].
const BELOW: f64 = 2.0;

/// Finds the height of the ground for a run that is to find it, once. Where it was given, says so if the object is seen below it.
///
/// # Errors
/// [`ErrorKind::Input`] when no frame shows the object; what writing the run's files returns.
pub(super) fn find_ground(clip: &Clip, run: &mut Run) -> Result<()> {
    if run.state.ground.is_some() {
        return Ok(());
    }
    if !run.config.world.find_ground {
        let (given, far) = (run.config.world.ground, BELOW * run.config.geometry.dx);
        // a single camera is not sure enough of heights
        let lowest = if clip.cameras.len() > 1 { lowest_point(clip) } else { None };
        if let Some(lowest) = lowest.filter(|lowest| *lowest < given - far) {
            run.note(format!(
                "the object is seen at y = {lowest:.3} m, below the ground at {given} m: if that is elsewhere, give its height with \
                 --ground, or --ground auto"
            ));
        }
        run.state.ground = Some(given);
        return Ok(());
    }
    let Some(height) = lowest_point(clip) else {
        return Err(Error::new(ErrorKind::Input, "the height of the ground cannot be found")
            .at(clip.root.display())
            .found("no frame in which the silhouettes of the object meet")
            .fix("check masks and cameras with `gradreel check`, or give the height in metres with --ground"));
    };
    run.config.world.ground = height;
    run.folder.write("config.toml", run.config.to_toml()?.as_bytes())?;
    run.state.ground = Some(height);
    run.note(format!("the ground was taken to be where the object is seen lowest, at y = {height:.4} m"));
    run.save()
}
