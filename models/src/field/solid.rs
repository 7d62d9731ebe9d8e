//! Filling of the interior, which no image constrains.

use gradreel::optim::Params;
use gradreel::{DType, Result, Tensor};

use crate::field::Field;
use crate::field::hull::node;
use crate::field::voxels::FILLED;

impl Field {
    /// Fills every interior voxel. Kept as they are: voxels reachable from outside through voxels of an opacity below
    /// ½, and the first opaque ones behind these.
    ///
    /// Images constrain the surface only. Interior gradients are almost zero, but Adam normalises them to full steps,
    /// which would open voids inside. A body can still be carved, one layer at a time, and open cavities stay open.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] when the store holds no field.
    pub fn fill_inside(&self, params: &mut Params) -> Result<()> {
        let raw = params.get("field.density")?.to_vec()?;
        let hidden = self.hidden(|voxel| raw[voxel] > 0.0);
        let filled = raw.iter().zip(hidden).map(|(&raw, hidden)| if hidden { raw.max(FILLED) } else { raw });
        params.set("field.density", Tensor::from_vec(filled.collect(), [self.len(), 1]).cast(DType::F32)?);
        Ok(())
    }

    /// Marks the voxels that are neither reachable from outside along the axes through transparent voxels, nor adjacent
    /// to one that is.
    fn hidden(&self, opaque: impl Fn(usize) -> bool) -> Vec<bool> {
        // a margin of one voxel connects all of the outside
        let dims = self.node_grid.dims.map(|n| n + 2);
        let strides = [dims[1] * dims[2], dims[2], 1];
        let places = self.voxels.iter().map(|&voxel| {
            let node = node(&self.node_grid, voxel as usize);
            (0..3).map(|axis| (node[axis] + 1) * strides[axis]).sum::<usize>()
        });
        let mut full = vec![false; dims.iter().product()];
        places.clone().enumerate().for_each(|(voxel, place)| full[place] = opaque(voxel));
        let (mut outside, mut shown) = (vec![false; full.len()], vec![false; full.len()]);
        let mut next = vec![0];
        outside[0] = true;
        while let Some(place) = next.pop() {
            for axis in 0..3 {
                let along = place / strides[axis] % dims[axis];
                let before = (along > 0).then(|| place - strides[axis]);
                let after = (along + 1 < dims[axis]).then(|| place + strides[axis]);
                for beside in before.into_iter().chain(after) {
                    shown[beside] = true;
                    if !full[beside] && !std::mem::replace(&mut outside[beside], true) {
                        next.push(beside);
                    }
                }
            }
        }
        places.map(|place| !shown[place]).collect()
    }
}

#[cfg(test)]
mod tests {
    use gradreel::ops::NodeGrid;
    use gradreel::optim::Params;
    use gradreel::{DType, Tensor};

    use super::{FILLED, Field};

    /// A cube of 7³ voxels with these raw densities.
    fn cube(raw: impl Fn([usize; 3]) -> f64) -> (Field, Params) {
        let nodes = (0..343usize).map(|i| [i / 49, i / 7 % 7, i % 7]);
        let mut params = Params::new();
        let raw = Tensor::from_vec(nodes.map(raw).collect(), [343, 1]).cast(DType::F32).unwrap();
        params.set("field.density", raw);
        let node_grid = NodeGrid { origin: [0.0; 3], spacing: 0.1, dims: [7; 3] };
        (Field { node_grid, voxels: (0..343).collect() }, params)
    }

    fn after_filling(raw: impl Fn([usize; 3]) -> f64) -> impl Fn([usize; 3]) -> f64 {
        let (field, mut params) = cube(raw);
        field.fill_inside(&mut params).unwrap();
        let filled = params.get("field.density").unwrap().to_vec().unwrap();
        move |[x, y, z]| filled[(x * 7 + y) * 7 + z]
    }

    #[test]
    fn a_void_is_filled_and_the_surface_is_left() {
        let is_void = |node: [usize; 3]| node.iter().all(|n| (2..5).contains(n));
        let raw = after_filling(|node| if is_void(node) { -3.0 } else { 0.5 });
        assert_eq!(raw([3, 3, 3]), FILLED, "the middle of the void");
        assert_eq!(raw([2, 3, 4]), FILLED, "its edge");
        assert_eq!(raw([1, 1, 1]), FILLED, "the second layer");
        assert_eq!(raw([0, 3, 3]), 0.5, "the outermost voxels are seen");
    }

    #[test]
    fn a_hollow_that_is_open_stays_open() {
        // a shaft from the top to the middle
        let in_shaft = |[x, y, z]: [usize; 3]| x == 3 && z == 3 && y >= 3;
        let raw = after_filling(|node| if in_shaft(node) { -3.0 } else { 0.5 });
        assert_eq!(raw([3, 3, 3]), -3.0, "the bottom of the shaft");
        assert_eq!(raw([3, 2, 3]), 0.5, "what is seen below it");
        assert_eq!(raw([2, 4, 3]), 0.5, "its walls");
        assert_eq!(raw([1, 4, 3]), FILLED, "behind them");
    }
}
