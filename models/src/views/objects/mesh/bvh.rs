//! A bounding-volume hierarchy that yields the triangles a ray may hit, near ones first.
//!
//! Boxes are split at the median along the axis of largest extent of the triangle centres. The surface-area
//! heuristic would visit fewer boxes, but small images cast few rays per object.

/// Maximum number of triangles per leaf.
const LEAF: usize = 4;
/// Maximum depth: boxes are split by count.
const DEEPEST: usize = 64;

/// Binary tree of bounding boxes.
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    /// The triangles in the order of the leaves.
    order: Vec<u32>,
}

struct Node {
    low: [f32; 3],
    high: [f32; 3],
    /// For a leaf, its first triangle in `order`; otherwise the second child (the first one follows directly).
    at: u32,
    /// Number of triangles of a leaf; 0 for an inner node.
    count: u32,
}

/// Bounding box: minimum and maximum coordinates.
type Bounds = [[f32; 3]; 2];

impl Bvh {
    /// The hierarchy of a nonempty list of triangles.
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        let boxes: Vec<Bounds> = triangles.iter().map(|corners| around(corners.iter().map(|x| [*x, *x]))).collect();
        let mut tree = Self { nodes: Vec::new(), order: (0..boxes.len() as u32).collect() };
        tree.divide(&boxes, 0, boxes.len());
        tree
    }

    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.order)
    }

    fn divide(&mut self, boxes: &[Bounds], from: usize, to: usize) {
        let of = |index: &u32| boxes[*index as usize];
        let [low, high] = around(self.order[from..to].iter().map(of));
        let own = self.nodes.len();
        self.nodes.push(Node { low, high, at: from as u32, count: (to - from) as u32 });
        if to - from <= LEAF {
            return;
        }
        let middle = |index: &u32| -> [f32; 3] {
            let [low, high] = of(index);
            std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]))
        };
        let [low, high] = around(self.order[from..to].iter().map(|index| [middle(index); 2]));
        let sides: [f32; 3] = std::array::from_fn(|axis| high[axis] - low[axis]);
        let axis = (0..3).fold(0, |best, axis| if sides[axis] > sides[best] { axis } else { best });
        let half = (from + to) / 2;
        self.order[from..to]
            .select_nth_unstable_by(half - from, |a, b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(b)));
        self.divide(boxes, from, half);
        let second = self.nodes.len() as u32;
        self.divide(boxes, half, to);
        (self.nodes[own].at, self.nodes[own].count) = (second, 0);
    }

    /// Calls `meet` for the triangles whose boxes a ray crosses; it returns the distance beyond which hits are
    /// irrelevant.
    pub fn visit(&self, origin: [f64; 3], along: [f64; 3], mut meet: impl FnMut(u32) -> f64) {
        let slopes = along.map(|x| 1.0 / if x.abs() < 1e-12 { 1e-12 } else { x });
        let mut waiting = [(0u32, 0.0f64); DEEPEST];
        let Some(near) = self.nodes[0].entered(origin, slopes, f64::INFINITY) else { return };
        waiting[0] = (0, near);
        let (mut count, mut limit) = (1, f64::INFINITY);
        while count > 0 {
            count -= 1;
            let (index, near) = waiting[count];
            if near > limit {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for &triangle in &self.order[node.at as usize..][..node.count as usize] {
                    limit = meet(triangle);
                }
                continue;
            }
            let children = [index + 1, node.at];
            let found = children.map(|child| self.nodes[child as usize].entered(origin, slopes, limit));
            // visit the nearer child first
            let swapped = matches!(found, [Some(first), Some(second)] if first < second);
            for child in if swapped { [1, 0] } else { [0, 1] } {
                if let Some(near) = found[child] {
                    waiting[count] = (children[child], near);
                    count += 1;
                }
            }
        }
    }
}

impl Node {
    /// Entry distance of a ray, if below the limit.
    fn entered(&self, origin: [f64; 3], slopes: [f64; 3], limit: f64) -> Option<f64> {
        let (mut near, mut far) = (0.0f64, limit);
        for axis in 0..3 {
            let ends = [self.low, self.high].map(|end| (f64::from(end[axis]) - origin[axis]) * slopes[axis]);
            near = near.max(ends[0].min(ends[1]));
            far = far.min(ends[0].max(ends[1]));
        }
        // a flat box has equal entry and exit distances up to rounding
        (near <= far * (1.0 + 1e-9) + 1e-9).then_some(near)
    }
}

fn around(boxes: impl Iterator<Item = Bounds>) -> Bounds {
    boxes.fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[low, high], other| {
        [[0, 1, 2].map(|axis| low[axis].min(other[0][axis])), [0, 1, 2].map(|axis| high[axis].max(other[1][axis]))]
    })
}
