//! Where the nodes of a grid are: what sampling a grid at points and scattering points to a grid share.

use crate::backend::gpu::words;
use crate::{DType, Error, ErrorKind, Result, Spec};

/// A regular grid of nodes: node `(i, j, k)` lies at `origin + spacing · (i, j, k)`.
///
/// ```
/// use gradreel::ops::NodeGrid;
/// let nodes = NodeGrid { origin: [0.0; 3], spacing: 0.1, dims: [4, 3, 2] };
/// assert_eq!(nodes.len(), 24);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeGrid {
    /// Position of node (0, 0, 0).
    pub origin: [f64; 3],
    /// Distance between neighbours along every axis.
    pub spacing: f64,
    /// Number of nodes per axis.
    pub dims: [usize; 3],
}

impl NodeGrid {
    /// Number of nodes.
    ///
    /// ```
    /// use gradreel::ops::NodeGrid;
    /// assert_eq!(NodeGrid { origin: [0.0; 3], spacing: 1.0, dims: [2, 3, 4] }.len(), 24);
    /// ```
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Whether there are no nodes.
    ///
    /// ```
    /// use gradreel::ops::NodeGrid;
    /// assert!(NodeGrid { origin: [0.0; 3], spacing: 1.0, dims: [0, 3, 4] }.is_empty());
    /// ```
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// How [`Var::grid_sample`](crate::Var::grid_sample) looks up a grid; the default is that of PyTorch's `grid_sample`.
///
/// ```
/// use gradreel::ops::{GridSampling, Padding};
/// let clamped = GridSampling { padding: Padding::Border, align_corners: true, ..GridSampling::default() };
/// assert_eq!(clamped.interpolation, gradreel::ops::Interpolation::Linear);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GridSampling {
    /// How values between nodes come about.
    pub interpolation: Interpolation,
    /// What lies outside the grid.
    pub padding: Padding,
    /// Whether −1 and 1 are the centres of the outermost nodes, or the outer faces of their cells.
    pub align_corners: bool,
}

/// How values between nodes come about.
///
/// ```
/// use gradreel::ops::Interpolation;
/// assert_eq!(Interpolation::default(), Interpolation::Linear);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Linear along each axis: bilinear in two, trilinear in three dimensions.
    #[default]
    Linear,
    /// The value of the nearest node (the one with the even number, halfway), which has no slope.
    Nearest,
}

/// What lies outside a grid.
///
/// ```
/// use gradreel::ops::Padding;
/// assert_eq!(Padding::default(), Padding::Zeros);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Padding {
    /// Nodes of value 0.
    #[default]
    Zeros,
    /// The nearest place on the border.
    Border,
}

/// One axis of a grid: component `component` of a point, `x`, is at node number `(x − origin) · scale + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Axis {
    pub(crate) size: usize,
    pub(crate) component: usize,
    pub(crate) origin: f64,
    pub(crate) scale: f64,
    pub(crate) shift: f64,
}

/// How points relate to the nodes of a grid, and how tensors hold the values of both.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Placement {
    /// The slowest axis first.
    pub(crate) axes: Vec<Axis>,
    pub(crate) nearest: bool,
    pub(crate) border: bool,
    /// Values are `[batch, channels, axes…]` at points `[batch, …, components]`; or else `[axes…, channels]` at points
    /// `[count, components]`.
    pub(crate) channels_first: bool,
}

/// Sizes of a lookup. A batch entry has `count` points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Extent {
    pub(crate) batch: usize,
    pub(crate) channels: usize,
    pub(crate) nodes: usize,
    pub(crate) count: usize,
}

impl Placement {
    /// The nodes of a grid.
    pub(crate) fn node_grid(node_grid: &NodeGrid) -> Self {
        let axis = |component: usize| Axis {
            size: node_grid.dims[component],
            component,
            origin: node_grid.origin[component],
            scale: 1.0 / node_grid.spacing,
            shift: 0.0,
        };
        Self { axes: (0..3).map(axis).collect(), nearest: false, border: false, channels_first: false }
    }

    /// Nodes over the square or cube from −1 to 1, the first component along the fastest axis.
    pub(crate) fn unit(sizes: &[usize], settings: GridSampling) -> Self {
        let axis = |(i, &size): (usize, &usize)| {
            let (length, shift) = if settings.align_corners { (size as f64 - 1.0, 0.0) } else { (size as f64, -0.5) };
            Axis { size, component: sizes.len() - 1 - i, origin: -1.0, scale: 0.5 * length, shift }
        };
        Self {
            axes: sizes.iter().enumerate().map(axis).collect(),
            nearest: settings.interpolation == Interpolation::Nearest,
            border: settings.padding == Padding::Border,
            channels_first: true,
        }
    }

    fn sizes(&self) -> Vec<usize> {
        self.axes.iter().map(|axis| axis.size).collect()
    }

    fn nodes(&self) -> usize {
        self.axes.iter().map(|axis| axis.size).product()
    }

    /// The sizes of a lookup of these values at these points, and the shape of its result.
    pub(crate) fn sampled(&self, op: &str, values: &Spec, points: &Spec) -> Result<(Extent, Spec)> {
        let rank = self.axes.len();
        let (dims, sizes, at) = (values.shape.dims(), self.sizes(), points.shape.dims());
        let found = match (self.channels_first, dims, at) {
            (true, [batch, channels, nodes @ ..], [entries, inner @ .., components]) => {
                let fits = batch == entries && nodes == sizes && *components == rank && !inner.is_empty();
                let shape = [&[*batch, *channels], inner].concat();
                fits.then(|| (*batch, *channels, inner.iter().product(), shape))
            }
            (false, [nodes @ .., channels], [count, components]) => {
                (nodes == sizes && *components == rank).then(|| (1, *channels, *count, vec![*count, *channels]))
            }
            _ => None,
        };
        match found.filter(|_| self.can_hold(values, points)) {
            Some((batch, channels, count, shape)) => {
                let extent = Extent { batch, channels, nodes: self.nodes(), count };
                Ok((extent, Spec::new(shape, values.dtype)))
            }
            None => Err(self.misfit(op, "values", self.grid("batch"), values, points)),
        }
    }

    /// The sizes of a scattering of these samples at these points, and the shape of its result.
    pub(crate) fn scattered(&self, op: &str, samples: &Spec, points: &Spec) -> Result<(Extent, Spec)> {
        let rank = self.axes.len();
        let (dims, sizes, at) = (samples.shape.dims(), self.sizes(), points.shape.dims());
        let found = match (self.channels_first, dims, at) {
            (true, [batch, channels, inner @ ..], [entries, places @ .., components]) => {
                let fits = batch == entries && inner == places && *components == rank && !inner.is_empty();
                let shape = [&[*batch, *channels], &sizes[..]].concat();
                fits.then(|| (*batch, *channels, inner.iter().product(), shape))
            }
            (false, [count, channels], [places, components]) => (count == places && *components == rank)
                .then(|| (1, *channels, *count, [&sizes[..], &[*channels]].concat())),
            _ => None,
        };
        match found.filter(|_| self.can_hold(samples, points)) {
            Some((batch, channels, count, shape)) => {
                let extent = Extent { batch, channels, nodes: self.nodes(), count };
                Ok((extent, Spec::new(shape, samples.dtype)))
            }
            None => {
                let wanted = if self.channels_first { "[batch, channels, …]" } else { "[count, channels]" };
                Err(self.misfit(op, "samples", wanted.to_owned(), samples, points))
            }
        }
    }

    /// Whether the kernels can number what there is, in one dtype.
    fn can_hold(&self, a: &Spec, b: &Spec) -> bool {
        let real = a.dtype == b.dtype && matches!(a.dtype, DType::F32 | DType::F64);
        real && self.nodes() > 0 && a.shape.len().max(b.shape.len()).max(2 * self.nodes()) < u32::MAX as usize
    }

    fn grid(&self, batch: &str) -> String {
        let sizes = self.sizes().iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        if self.channels_first { format!("[{batch}, channels, {sizes}]") } else { format!("[{sizes}, channels]") }
    }

    fn misfit(&self, op: &str, what: &str, wanted: String, a: &Spec, points: &Spec) -> Error {
        let rank = self.axes.len();
        let places = if self.channels_first { format!("[batch, …, {rank}]") } else { format!("[count, {rank}]") };
        Error::new(ErrorKind::Shape, format!("{op}: the operands do not fit"))
            .found(format!("{what} {a:?} at points {points:?}"))
            .wanted(format!("{wanted} at {places}, both f32 or both f64, every axis of the grid at least 1 long"))
    }

    /// The words of the uniform struct of `kernels/shared/grid.wgsl`.
    pub(crate) fn words(&self, extent: Extent, len: usize) -> Vec<u32> {
        let Extent { batch, channels, nodes, count } = extent;
        // steps from node to node, channel to channel, and to the next batch entry: of grids, then of samples
        let steps = |rows: usize| if self.channels_first { [1, rows] } else { [channels, 1] };
        let ([node, value], [point, sample]) = (steps(nodes), steps(count));
        let corners = if self.nearest { 1 } else { 1 << self.axes.len() };
        let mut all = words([len, self.axes.len(), corners, usize::from(self.border)]).to_vec();
        all.extend(words([batch, channels, nodes, count]));
        all.extend(words([node, value, point, sample]));
        let mut stride = nodes;
        let mut maps = Vec::new();
        for i in 0..3 {
            let Some(axis) = self.axes.get(i) else {
                all.extend([0; 4]);
                maps.extend([0; 4]);
                continue;
            };
            stride /= axis.size;
            all.extend(words([axis.size, stride, axis.component, 0]));
            maps.extend([axis.origin, axis.scale, axis.shift, axis.size as f64 - 1.0].map(|x| (x as f32).to_bits()));
        }
        all.extend(maps);
        all
    }
}
