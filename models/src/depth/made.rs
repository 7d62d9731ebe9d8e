//! Procedural solids as meshes.

use std::sync::Arc;

use gradreel::Key;
use rayon::prelude::*;

use super::Solid;
use crate::views::objects::Made;

/// So many procedural solids by a key, with `nodes` grid nodes along their longest sides. Each depends on the key and its
/// number alone.
pub(crate) fn made_solids(key: Key, count: usize, nodes: usize) -> Vec<Arc<Solid>> {
    (0..count).into_par_iter().map(|number| Arc::new(solid(key.fold(number as u64), nodes))).collect()
}

fn solid(key: Key, nodes: usize) -> Solid {
    let made = Made::new(key.split(), nodes);
    let (corners, triangles) = made.field().net();
    let byte = |x: f64| (255.0 * x.clamp(0.0, 1.0)).round() as u8;
    let colours = corners.iter().map(|corner| made.colour(*corner).map(byte)).collect();
    // z is up there, y here
    let corners = corners.iter().map(|&[x, y, z]| [x as f32, z as f32, -y as f32]).collect();
    Solid::new(corners, colours, triangles).expect("a body has a surface")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn procedural_solids_have_the_size_of_real_ones_and_differ() {
        let solids = made_solids(Key::new(1), 6, 20);
        for solid in &solids {
            let side = |axis: usize| {
                let of = |c: &[f32; 3]| c[axis];
                let (low, high) =
                    solid.corners().iter().map(of).fold((9.0f32, -9.0f32), |(a, b), x| (a.min(x), b.max(x)));
                high - low
            };
            let longest = (0..3).map(side).fold(0.0, f32::max);
            assert!((0.85..1.05).contains(&longest), "{longest}");
        }
        assert!(solids.windows(2).all(|pair| pair[0] != pair[1]));
        // a solid does not depend on how many there are
        assert_eq!(made_solids(Key::new(1), 3, 20), solids[..3]);
    }
}
