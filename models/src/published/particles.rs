//! The particles of a temporal field's first frame.

use gradreel::ops::NodeGrid;
use gradreel::optim::{Adam, Params};
use gradreel::{DType, Error, ErrorKind, Result, Tensor};

use crate::field::temporal::TemporalFit;
use crate::field::{Field, fit, opacity, opacity_shift, place};
use crate::identify::{Config, Observed, Problem, Unknowns};
use crate::particles::Particles;
use crate::physics::Law;
use crate::video::Clip;

/// Opacity over one unit of length above which a node of the field is filled.
const OPAQUE: f64 = 0.5;

/// Opacity of a node that may turn out to be filled when the pictures are drawn with particles.
const FAINT: f64 = 0.02;

/// Raw density of filled voxels, and the range of that of others.
const FILLED: f64 = 4.0;
const FAINTEST: f64 = -4.0;

/// The largest number of voxels around an object.
const MOST_VOXELS: f64 = 4e6;

/// The field's first frame on voxels of the simulation's particles, solid within its surface: what lies behind that no picture tells.
///
/// # Errors
/// [`ErrorKind::Input`] when the field is empty, or has too many voxels.
pub(super) fn baked(found: &TemporalFit, spacing: f64, clip: &Clip) -> Result<(Field, Params)> {
    let (low, high) = (found.field.grid.low, found.field.grid.high);
    let first = low.map(|x| (x / spacing).floor());
    let dims = [0, 1, 2].map(|axis| (high[axis] / spacing).ceil() - first[axis] + 1.0);
    if dims.iter().product::<f64>() > MOST_VOXELS {
        return Err(Error::new(ErrorKind::Input, "the voxels are too fine for the object")
            .at("geometry.dx")
            .found(format!("{dims:?} voxels {spacing} m apart"))
            .wanted(format!("at most {MOST_VOXELS:e} around it"))
            .fix("raise geometry.dx (--dx), twice the spacing of the voxels"));
    }
    let node_grid = NodeGrid { origin: first.map(|i| (i + 0.5) * spacing), spacing, dims: dims.map(|n| n as usize) };
    let points: Vec<[f64; 3]> = (0..node_grid.len()).map(|flat| place(&node_grid, flat)).collect();
    let shift = opacity_shift(found.field.settings.opacity);
    let density = found.field.density_at(&found.params, &points, 0.0)?;
    let alpha: Vec<f64> = density.iter().map(|d| opacity(*d, shift, 1.0)).collect();
    // a field that was fitted shortly is faint everywhere
    let most = alpha.iter().copied().fold(0.0, f64::max);
    let least = if most > FAINT { OPAQUE.min(0.5 * most) } else { OPAQUE };
    let filled: Vec<bool> = alpha.iter().map(|alpha| *alpha >= least).collect();
    let filled = largest_part(&closed(&filled, node_grid.dims), node_grid.dims);
    if !filled.contains(&true) {
        return Err(Error::new(ErrorKind::Input, "the temporal field is empty in its first frame")
            .at(clip.root.display())
            .found(format!("no node with an opacity above {FAINT}"))
            .fix("check masks and boxes with `gradreel check`, or let it fit longer (published.field)"));
    }
    let field = Field { node_grid, voxels: (0..node_grid.len() as u32).collect() };
    let logit = |alpha: f64| (alpha / (1.0 - alpha)).ln().clamp(FAINTEST, 0.0);
    let raw = alpha.iter().zip(&filled).map(|(alpha, filled)| if *filled { FILLED } else { logit(*alpha) } as f32);
    let raw: Vec<f32> = raw.collect();
    let mut params = Params::new();
    params.set("field.density", Tensor::from_vec(raw, [field.len(), 1]));
    field.fill_inside(&mut params)?;
    let mean = crate::field::mean_colour(&clip.single(0)).map(|c| {
        let c = c.clamp(0.02, 0.98);
        (c / (1.0 - c)).ln() as f32
    });
    params.set("field.colour", Tensor::from_vec(mean.repeat(field.len()), [field.len(), 3]));
    // what the field has faintly, and two layers around the rest: the pictures may add to the surface
    let near = widened(&widened(&filled_of(&params)?, node_grid.dims), node_grid.dims);
    field.chosen(&params, &|voxel| near[voxel] || alpha[voxel] >= FAINT)
}

/// Fits the voxels to the first frame's pictures, drawn as the simulation's particles are.
///
/// # Errors
/// What the renderer and `each` return.
pub(super) fn refined(
    (field, params): (Field, Params),
    observed: &Observed,
    law: &Law,
    config: &Config,
    each: &mut dyn FnMut(usize, f64) -> Result<()>,
) -> Result<(Field, Params)> {
    let settings = &config.geometry.fit;
    let particles = Particles::of_field(&field, &params, 0.0)?;
    let problem = Problem::new(&particles, observed, law.clone(), config, DType::F32).flying();
    let still = Unknowns { parameters: config.starting_values(law)?, ..Unknowns::default() };
    let schedule = problem.schedule(&still, 1);
    let loss = |_: &gradreel::optim::Bound, opacity: &gradreel::Var, colour: &gradreel::Var| {
        let bound = still.constants(opacity.tape(), DType::F32)?;
        let positions = problem.motion_of(opacity, &bound, schedule)?.select(0, 0);
        let pixels = problem.render(&positions, opacity, colour, &observed.rays)?;
        Ok(observed.targets[0].loss(&pixels))
    };
    let smooth = Some((field.faces(), config.smoothness_of(law))).filter(|(_, counts)| *counts > 0.0);
    let adam: Adam = settings.adam();
    let fitted =
        fit(&field, params, adam, 0..settings.iterations, smooth, &loss, |state| each(state.iteration, state.loss))?;
    let (field, fitted) = field.pruned(&fitted, 0.5 * config.geometry.least_opacity)?;
    // specks beside the body would fall as bodies of their own
    let mut dense = vec![false; field.node_grid.len()];
    field.voxels.iter().for_each(|voxel| dense[*voxel as usize] = true);
    let body = largest_part(&dense, field.node_grid.dims);
    field.chosen(&fitted, &|voxel| body[field.voxels[voxel] as usize])
}

fn filled_of(params: &Params) -> Result<Vec<bool>> {
    Ok(params.get("field.density")?.to_vec()?.iter().map(|raw| *raw > 0.0).collect())
}

/// The flat indices beside a node along the axes.
fn beside(flat: usize, dims: [usize; 3]) -> impl Iterator<Item = usize> {
    let strides = [dims[1] * dims[2], dims[2], 1];
    (0..3).flat_map(move |axis| {
        let along = flat / strides[axis] % dims[axis];
        let before = (along > 0).then(|| flat - strides[axis]);
        let after = (along + 1 < dims[axis]).then(|| flat + strides[axis]);
        before.into_iter().chain(after)
    })
}

fn widened(filled: &[bool], dims: [usize; 3]) -> Vec<bool> {
    (0..filled.len()).map(|flat| filled[flat] || beside(flat, dims).any(|other| filled[other])).collect()
}

/// Pits and pinholes of a surface closed: what has four filled neighbours of six. A flat, an edge or a corner grows nowhere.
fn closed(filled: &[bool], dims: [usize; 3]) -> Vec<bool> {
    (0..filled.len())
        .map(|flat| filled[flat] || beside(flat, dims).filter(|other| filled[*other]).count() >= 4)
        .collect()
}

/// The largest connected part.
fn largest_part(filled: &[bool], dims: [usize; 3]) -> Vec<bool> {
    let mut part_of = vec![0usize; filled.len()];
    let (mut parts, mut best) = (0, (0, 0));
    for start in 0..filled.len() {
        if !filled[start] || part_of[start] > 0 {
            continue;
        }
        parts += 1;
        part_of[start] = parts;
        let (mut waiting, mut count) = (vec![start], 0);
        while let Some(flat) = waiting.pop() {
            count += 1;
            for next in beside(flat, dims) {
                if filled[next] && part_of[next] == 0 {
                    part_of[next] = parts;
                    waiting.push(next);
                }
            }
        }
        best = best.max((count, parts));
    }
    part_of.iter().map(|part| *part > 0 && *part == best.1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_closed_and_specks_are_left_out() {
        let dims = [9, 9, 9];
        let node = |flat: usize| [flat / 81, flat / 9 % 9, flat % 9];
        let inside = |flat: usize| node(flat).iter().all(|n| (2..7).contains(n));
        let mut filled: Vec<bool> = (0..729).map(inside).collect();
        let gap = 4 * 81 + 4 * 9 + 2;
        filled[gap] = false;
        filled[0] = true;
        let found = largest_part(&closed(&filled, dims), dims);
        assert!(found[gap] && !found[0]);
        assert_eq!(found.iter().filter(|filled| **filled).count(), 125);
    }
}
