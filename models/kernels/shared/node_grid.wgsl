// Which nodes exist in this substep: the box around the stencils of all particles, as the substep before has marked it.
//
// Marks begin with the number of the first substep that failed. For each substep there follow the lowest and the highest cell
// of a particle (both counted from -BIAS), the first particle that broke a limit, and the first whose stress is not finite.
// A cell has the number of the lowest node of its stencil, floor(x/dx - ½).
const HEADER: u32 = 8u;
const PER_STEP: u32 = 8u;
const BROKEN: u32 = 6u;
const CULPRIT: u32 = 7u;
const BIAS: i32 = 0x40000000;
// Cells beyond this are too far away for single precision.
const FAR: i32 = 0x1fffff;

struct NodeGrid {
    // world index of the first node
    low: vec3<i32>,
    // nodes along each axis
    shape: vec3<i32>,
    // whether no substep has failed before this one
    sound: bool,
    // whether there is room for it
    fits: bool,
}

fn mark_of(step: u32, k: u32) -> u32 {
    return HEADER + PER_STEP * step + k;
}

fn node_grid_now() -> NodeGrid {
    let at = mark_of(substep.step, 0u);
    let low = vec3<i32>(vec3<u32>(mark(at), mark(at + 1u), mark(at + 2u))) - BIAS;
    let high = vec3<i32>(vec3<u32>(mark(at + 3u), mark(at + 4u), mark(at + 5u))) - BIAS;
    var node_grid: NodeGrid;
    node_grid.low = low;
    node_grid.shape = high - low + 3;
    let lengths = vec3<f32>(node_grid.shape);
    node_grid.fits = all(low > vec3<i32>(-FAR)) && all(high < vec3<i32>(FAR))
        && lengths.x * lengths.y * lengths.z <= f32(substep.capacity);
    node_grid.sound = mark(0u) >= substep.step;
    return node_grid;
}

// The cell of a position, before it is known to lie in the grid.
fn free_cell(x: vec3<f32>) -> vec3<i32> {
    return vec3<i32>(floor(x * substep.inverse_dx - 0.5));
}

// The cell of a position, from the first node. Rounding that differs between kernels cannot lead out of the grid; the
// weights are continuous, so it does not matter on which side of a border a particle is.
fn cell_of(node_grid: NodeGrid, x: vec3<f32>) -> vec3<i32> {
    return clamp(free_cell(x) - node_grid.low, vec3<i32>(0), node_grid.shape - 3);
}

fn node_number(node_grid: NodeGrid, node: vec3<i32>) -> u32 {
    return u32((node.x * node_grid.shape.y + node.y) * node_grid.shape.z + node.z);
}
