//! How high the ground is, when nobody said: where the object came down.

use gradreel::{Error, ErrorKind, Result};

use crate::identify::model::flight::displacement;
use crate::identify::pipeline::reconstruct::rough_hull;
use crate::identify::{Run, velocity_of_silhouettes};
use crate::video::Clip;

/// Frames of flight that tell the velocity.
const FLIGHT: usize = 3;

/// How far the middle of what flies may be from where its fall leads, as a share of its radius.
const STRAYS: f64 = 0.1;

/// Frames after the fall in which the object is looked at: it has not spread yet. Hulls of flat things that all cameras look down upon reach
/// far below them.
const LANDED: usize = 2;

/// Where the ground \[m\] is under an object that comes down: the lowest point of what its silhouettes leave room for, in its fall and the first
/// frames after it; `None` where they leave no room.
pub(in crate::identify) fn landing(clip: &Clip, gravity: [f64; 3]) -> Option<f64> {
    let velocity = velocity_of_silhouettes(clip, gravity, FLIGHT)?;
    let (mut start, mut lowest, mut left) = (None, f64::INFINITY, LANDED);
    for frame in 0..clip.frame_count() {
        let Some(Room { bottom, middle, radius }) = Room::of(clip, frame) else { continue };
        lowest = lowest.min(bottom);
        let fallen = displacement(velocity, gravity, clip.times[frame] - clip.times[0])[1];
        let start = *start.get_or_insert(middle - fallen);
        if (middle - (start + fallen)).abs() > STRAYS * radius {
            left -= 1;
        }
        if left == 0 {
            break;
        }
    }
    lowest.is_finite().then_some(lowest)
}

/// The room that silhouettes leave for an object.
struct Room {
    /// Its lowest point \[m\].
    bottom: f64,
    /// The height of its middle \[m\].
    middle: f64,
    /// Half its width \[m\].
    radius: f64,
}

impl Room {
    fn of(clip: &Clip, frame: usize) -> Option<Self> {
        let (sphere, hull) = rough_hull(clip, frame).ok()?;
        let spacing = hull.node_grid.spacing;
        let [_, rows, columns] = hull.node_grid.dims;
        let height = |flat: &u32| hull.node_grid.origin[1] + (*flat as usize / columns % rows) as f64 * spacing;
        let bottom = hull.voxels.iter().map(height).reduce(f64::min)? - 0.5 * spacing;
        let middle = hull.voxels.iter().map(height).sum::<f64>() / hull.voxels.len() as f64;
        Some(Self { bottom, middle, radius: sphere.radius })
    }
}

/// How far below the ground an object may be seen before it is said \[grid spacings\].
const BELOW: f64 = 2.0;

/// Finds the height of the ground for a run that is to find it, once. Where it was given, says so if the object is seen below it.
///
/// # Errors
/// [`ErrorKind::Input`] when no frame shows the object; what writing the run's files returns.
pub(in crate::identify) fn find_ground(clip: &Clip, run: &mut Run) -> Result<()> {
    if run.state.ground.is_some() {
        return found(run);
    }
    if !run.config.world.find_ground {
        let (given, far) = (run.config.world.ground, BELOW * run.config.geometry.dx);
        // a single camera is not sure enough of heights
        let lowest = if clip.cameras.len() > 1 { landing(clip, run.config.world.gravity) } else { None };
        if let Some(lowest) = lowest.filter(|lowest| *lowest < given - far) {
            run.note(format!(
                "the object is seen at y = {lowest:.3} m, below the ground at {given} m: if that is elsewhere, give its height with \
                 --ground, or --ground auto"
            ));
        }
        run.state.ground = Some(given);
        return Ok(());
    }
    let Some(height) = landing(clip, run.config.world.gravity) else {
        return Err(Error::new(ErrorKind::Input, "the height of the ground cannot be found")
            .at(clip.root.display())
            .found("no frame in which the silhouettes of the object meet")
            .fix("check masks and cameras with `gradreel check`, or give the height in metres with --ground"));
    };
    run.state.ground = Some(height);
    run.note(format!("the ground was taken to be where the object lands, at y = {height:.4} m"));
    run.save()?;
    found(run)
}

/// Makes the configuration say what was found; a run may have been killed after that.
fn found(run: &mut Run) -> Result<()> {
    match run.state.ground.filter(|height| run.config.world.find_ground && *height != run.config.world.ground) {
        Some(height) => {
            run.config.world.ground = height;
            run.save_config()
        }
        None => Ok(()),
    }
}
