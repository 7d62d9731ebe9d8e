//! The grid's box: the nodes that exist in one substep.
//!
//! Node `i` lies at `i · dx` in the world, so that node (0, 0, 0) is always the world's origin. The box covers the
//! particles' stencils; it depends on the particles' extent only.

use super::row::Number;
use super::stencil::{BATCH, Batch};
use gradreel::{Error, ErrorKind, Result};

/// Node planes per slab, the unit of parallel scatter. A stencil extends at most two planes into the next slab, so that
/// slabs two apart never share a node.
pub(crate) const SLAB: usize = 2;

/// Indices of the particles sorted by material, then by the cell of their stencil, for node spacing `dx` \[m\].
/// Neighbours in space become neighbours in memory. A [`Simulation`](super::Simulation) is fastest in this order; a
/// [`rollout`](super::rollout()) sorts its particles itself.
pub fn neighbours<T: Number>(dx: f64, positions: &[[T; 3]], material: impl Fn(usize) -> u32) -> Vec<u32> {
    let node_grid = NodeGrid::of_spacing(dx);
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_by_cached_key(|&p| (material(p as usize), positions[p as usize].map(|x| node_grid.locate(x).0)));
    order
}

/// A dense box of grid nodes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeGrid<T> {
    /// Node spacing \[m\].
    pub dx: T,
    /// `1/dx` \[1/m\]
    pub inverse_dx: T,
    /// World index of the first node. Along x a multiple of [`SLAB`], so that slabs do not depend on the box.
    pub origin: [i32; 3],
    /// Nodes per axis.
    pub shape: [usize; 3],
    /// Stride between neighbours along x and y, in values; along z it is 4.
    pub stride: [usize; 2],
}

impl<T: Number> NodeGrid<T> {
    /// The box for particles within `extent` (lowest and highest coordinates \[m\]).
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Physics`] when it would have more than `limit` nodes.
    pub fn covering(extent: [[T; 3]; 2], dx: f64, limit: usize) -> Result<Self> {
        let too_large = |nodes: String| {
            let place: Vec<String> = (0..3)
                .map(|axis| format!("{:.4}..{:.4} m", extent[0][axis].to_f64(), extent[1][axis].to_f64()))
                .collect();
            Error::new(ErrorKind::Physics, "the particles have flown too far apart for the grid")
                .at(format!("the particles' extent, {}", place.join(" x ")))
                .found(nodes)
                .wanted(format!("at most {limit} nodes (World::node_limit)"))
                .fix("remove stray particles, give the world bounds, or raise the limit")
        };
        let mut node_grid = Self::of_spacing(dx);
        let far = (T::SPLITTABLE - 1.0) * dx;
        if !extent.iter().flatten().all(|x| x.to_f64().abs() < far) {
            return Err(too_large(format!("coordinates beyond {far:.3e} m")));
        }
        let [low, high] = extent.map(|corner| corner.map(|x| node_grid.locate(x).0));
        let slab = SLAB as i32;
        node_grid.origin = [low[0].div_euclid(slab) * slab, low[1], low[2]];
        // One more plane of nodes along z, as a row may carry a fourth node.
        node_grid.shape = std::array::from_fn(|axis| (high[axis] - node_grid.origin[axis]) as usize + 3 + axis / 2);
        let nodes = node_grid.shape.iter().map(|&n| n as f64).product::<f64>();
        if nodes > limit as f64 {
            let [x, y, z] = node_grid.shape;
            return Err(too_large(format!("a box of {x} x {y} x {z} nodes")));
        }
        node_grid.stride = [4 * node_grid.shape[1] * node_grid.shape[2], 4 * node_grid.shape[2]];
        Ok(node_grid)
    }

    /// An empty grid with this spacing \[m\].
    pub fn of_spacing(dx: f64) -> Self {
        let [dx, inverse_dx] = [dx, 1.0 / dx].map(T::from_f64);
        Self { dx, inverse_dx, origin: [0; 3], shape: [0; 3], stride: [0; 2] }
    }

    /// Number of values in the grid, four per node.
    pub fn len(&self) -> usize {
        self.shape[0] * self.stride[0]
    }

    /// The world index of the lowest node of a stencil along an axis, `floor(x/dx − ½)`, and `x/dx` minus it, in
    /// `[½, 1½)`.
    #[inline(always)]
    pub fn locate(&self, x: T) -> (i32, T) {
        let scaled = x * self.inverse_dx;
        let (integer, floor) = (scaled - T::from_f64(0.5)).split();
        (integer, scaled - floor)
    }

    /// The slab in which a stencil starts, from its x coordinate.
    #[inline(always)]
    pub fn slab(&self, x: T) -> usize {
        (self.locate(x).0 - self.origin[0]) as usize / SLAB
    }

    /// Number of slabs.
    pub fn slabs(&self) -> usize {
        self.shape[0].saturating_sub(2).div_ceil(SLAB)
    }

    /// The offsets at which the stencils with lowest nodes `base[axis]` begin, in a region of `planes` node planes from
    /// `first_plane` on.
    ///
    /// # Panics
    ///
    /// If, for any stencil, nine rows of four nodes from the offset do not lie in the region. The memory safety of the
    /// transfers depends on it.
    #[inline(always)]
    pub fn starts(&self, base: &[Batch<i32>; 3], first_plane: usize, planes: usize) -> Batch<usize> {
        let mut starts = [0; BATCH];
        let mut inside = true;
        for i in 0..BATCH {
            // negative offsets wrap around to large ones
            let [x, y, z] = [0, 1, 2].map(|axis| base[axis][i].wrapping_sub(self.origin[axis]) as u32 as usize);
            let x = x.wrapping_sub(first_plane);
            inside &= (x < planes.saturating_sub(2))
                & (y < self.shape[1].saturating_sub(2))
                & (z < self.shape[2].saturating_sub(3));
            starts[i] = x.wrapping_mul(self.stride[0]).wrapping_add(y.wrapping_mul(self.stride[1])).wrapping_add(4 * z);
        }
        assert!(inside, "a stencil outside the grid's box");
        starts
    }

    /// # Panics
    ///
    /// If `grid` is smaller than the box. The memory safety of the transfers depends on it.
    #[inline(always)]
    pub fn check_whole(&self, grid: &[T]) {
        assert!(grid.len() >= self.shape[0] * self.stride[0], "a grid smaller than its grid");
    }

    /// World coordinates of a node \[m\].
    #[inline(always)]
    pub fn node(&self, index: [usize; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(self.origin[axis] + index[axis] as i32) * self.dx.to_f64())
    }
}
