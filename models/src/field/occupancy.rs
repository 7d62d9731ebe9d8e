//! Occupancy: which nodes of a grid may be opaque.

use super::DenseGrid;

/// Length over which a node's opacity is evaluated, in the length unit of the raw density.
const STRETCH: f64 = 0.5;

/// A mask over the nodes of a grid. Nodes are only ever switched off.
#[derive(Debug, Clone, PartialEq)]
pub struct Occupancy {
    /// The grid.
    pub grid: DenseGrid,
    /// One entry per node, z fastest.
    pub occupied: Vec<bool>,
}

/// The opacity `1 − (1 + e^{d + shift})^{−stretch}` of a raw density.
#[inline(always)]
pub(crate) fn opacity(density: f64, shift: f64, stretch: f64) -> f64 {
    let x = density + shift;
    let softplus = x.max(0.0) + (-x.abs()).exp().ln_1p();
    -(-stretch * softplus).exp_m1()
}

impl Occupancy {
    /// A mask with every node occupied.
    pub fn full(grid: DenseGrid) -> Self {
        let occupied = vec![true; grid.len()];
        Self { grid, occupied }
    }

    /// Switches off the nodes at which the largest opacity over a length of 0.5, of the node and its 26 neighbours, is
    /// at most `threshold`. `density` holds the raw density of every node.
    ///
    /// # Panics
    /// When `density` does not have one entry per node.
    #[track_caller]
    pub fn update(&mut self, density: &[f64], shift: f64, threshold: f64) {
        assert_eq!(density.len(), self.occupied.len(), "one density for each node");
        let mut near: Vec<bool> = density.iter().map(|&d| opacity(d, shift, STRETCH) > threshold).collect();
        // the maximum over 3³ nodes is separable
        let [nx, ny, nz] = self.grid.dims;
        for (size, stride) in [(nx, ny * nz), (ny, nz), (nz, 1)] {
            let before = near.clone();
            for (i, out) in near.iter_mut().enumerate() {
                let place = i / stride % size;
                *out |= (place > 0 && before[i - stride]) || (place + 1 < size && before[i + stride]);
            }
        }
        self.occupied.iter_mut().zip(near).for_each(|(occupied, near)| *occupied &= near);
    }

    /// The box of the occupied nodes \[m\], at `low + n · spacing`; `None` when there are none.
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let [_, ny, nz] = self.grid.dims;
        let nodes = self.occupied.iter().enumerate().filter(|(_, occupied)| **occupied);
        let numbers = nodes.map(|(i, _)| [i / (ny * nz), i / nz % ny, i % nz]);
        let [first, last] = numbers.fold([[usize::MAX; 3], [0; 3]], |[first, last], n| {
            [[0, 1, 2].map(|a| first[a].min(n[a])), [0, 1, 2].map(|a| last[a].max(n[a]))]
        });
        let place = |n: [usize; 3]| [0, 1, 2].map(|a| self.grid.low[a] + n[a] as f64 * self.grid.spacing);
        (first[0] != usize::MAX).then(|| [place(first), place(last)])
    }

    /// Whether the node nearest to a point is occupied (ties round away from zero); false outside the grid.
    pub fn contains(&self, x: [f64; 3]) -> bool {
        let (scale, dims) = (self.grid.scale(), self.grid.dims);
        // this order of rounding resolves ties as the published code does
        let node = [0, 1, 2].map(|axis| (x[axis] * scale[axis] + -self.grid.low[axis] * scale[axis]).round());
        (0..3).all(|axis| node[axis] >= 0.0 && node[axis] < dims[axis] as f64) && {
            let [i, j, k] = node.map(|n| n as usize);
            self.occupied[(i * dims[1] + j) * dims[2] + k]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_keeps_its_neighbours() {
        let grid = DenseGrid::of_spacing([0.0; 3], [0.4, 0.3, 0.2], 0.1).unwrap();
        let mut occupancy = Occupancy::full(grid.clone());
        assert_eq!(occupancy.bounds(), Some([[0.0; 3], [0.4, 0.1 * 3.0, 0.2]]));
        let mut density = vec![-100.0; grid.len()];
        density[(4 * 4 + 1) * 3 + 1] = 5.0; // node (4, 1, 1)
        occupancy.update(&density, 0.0, 1e-3);
        assert_eq!(occupancy.occupied.iter().filter(|o| **o).count(), 2 * 3 * 3);
        assert!(occupancy.contains([0.26, 0.0, 0.0]) && !occupancy.contains([0.24, 0.0, 0.0]));
        assert!(!occupancy.contains([0.46, 0.1, 0.1]));
        occupancy.update(&vec![5.0; grid.len()], 0.0, 1e-3);
        assert_eq!(occupancy.occupied.iter().filter(|o| **o).count(), 18, "off stays off");
        occupancy.update(&vec![-100.0; grid.len()], 0.0, 1e-3);
        assert_eq!(occupancy.bounds(), None);
    }

    #[test]
    fn opacity_of_extreme_densities() {
        assert!((opacity(0.0, 0.0, 1.0) - 0.5).abs() < 1e-15);
        assert_eq!(opacity(-1e4, 0.0, 1.0), 0.0);
        assert_eq!(opacity(1e4, 0.0, 1.0), 1.0);
        assert!((opacity(-30.0, 0.0, 1.0) / (-30.0f64).exp() - 1.0).abs() < 1e-12);
    }
}
