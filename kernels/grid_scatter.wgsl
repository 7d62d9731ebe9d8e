// What points spread to the nodes of a regular grid, as sums that each node makes: no atomics, the same bits every time.
//
// `cells` numbers the cell of every point; the host sorts the points by it (kernels/sort_pairs.wgsl); `find_starts` finds
// where the points of each cell begin; in `gather` each invocation adds up one channel of one node over the points of the
// cells around it.
#import "shared/linear.wgsl"
#import "shared/grid.wgsl"

// Sizes of the sorted list.
struct Sorted {
    len: u32,
    count: u32,
}

@group(0) @binding(0) var<uniform> sizes: Grid;
@group(0) @binding(1) var<uniform> list: Sorted;
@group(0) @binding(2) var<storage, read> points: array<f32>;
@group(0) @binding(3) var<storage, read> samples: array<f32>;
// cell and number of each point
@group(0) @binding(4) var<storage, read> sorted: array<u32>;
@group(0) @binding(5) var<storage, read> starts: array<u32>;
@group(0) @binding(6) var<storage, read_write> pairs: array<u32>;
@group(0) @binding(7) var<storage, read_write> begins: array<u32>;
@group(0) @binding(8) var<storage, read_write> y: array<f32>;

// The cell of a point that reaches no node: sorted last and never looked up.
const FAR: u32 = 0xffffffffu;

// A component of a point that is not finite, or 0.
fn poison_of(point: u32) -> f32 {
    var poison = 0.0;
    for (var axis = 0u; axis < sizes.rank; axis++) {
        let x = points[point * sizes.rank + axis];
        if !is_finite(x) {
            poison = x;
        }
    }
    return poison;
}

fn hat_at(axis: u32, point: u32, poison: f32) -> Hat {
    let x = points[point * sizes.rank + sizes.axes[axis].z];
    return hat_of(axis, x, poison, sizes.corners == 1u, sizes.border == 1u, sizes.maps[axis]);
}

@compute @workgroup_size(WORKGROUP)
fn cells(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p >= sizes.len {
        return;
    }
    let poison = poison_of(p);
    var cell = p / sizes.count;
    var near = true;
    for (var axis = 0u; axis < sizes.rank; axis++) {
        let hat = hat_at(axis, p, poison);
        near = near && hat.near;
        // the cell before the first node is number 0
        cell = cell * (sizes.axes[axis].x + 1u) + u32(hat.base + 1);
    }
    pairs[2u * p] = select(FAR, cell, near);
    pairs[2u * p + 1u] = p;
}

@compute @workgroup_size(WORKGROUP)
fn find_starts(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let cell = linear_group(group, groups) * WORKGROUP + local;
    if cell >= list.len {
        return;
    }
    // the first pair of this cell or a later one lies in low … high
    var low = 0u;
    var high = list.count;
    while low < high {
        let middle = low + (high - low) / 2u;
        if sorted[2u * middle] < cell {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    begins[cell] = low;
}

@compute @workgroup_size(WORKGROUP)
fn gather(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.len {
        return;
    }
    let inner = i % (sizes.channels * sizes.nodes);
    let batch = i / (sizes.channels * sizes.nodes);
    // the smaller step runs fastest
    var channel = inner % sizes.channels;
    var node = inner / sizes.channels;
    if sizes.node_step == 1u && sizes.value_step != 1u {
        channel = inner / sizes.nodes;
        node = inner % sizes.nodes;
    }
    var total = 0.0;
    // the cells of which this node is the upper one along every axis come first
    for (var step = 0u; step < sizes.corners; step++) {
        let corner = sizes.corners - 1u - step;
        var cell = batch;
        for (var axis = 0u; axis < sizes.rank; axis++) {
            let extent = sizes.axes[axis];
            cell = cell * (extent.x + 1u) + node / extent.y % extent.x + 1u - side_of(corner, axis, sizes.rank);
        }
        for (var at = starts[cell]; at < starts[cell + 1u]; at++) {
            let p = sorted[2u * at + 1u];
            let poison = poison_of(p);
            var weight = 1.0;
            for (var axis = 0u; axis < sizes.rank; axis++) {
                weight *= hat_at(axis, p, poison).weight[side_of(corner, axis, sizes.rank)];
            }
            let place = batch * sizes.channels * sizes.count + p % sizes.count * sizes.point_step;
            // not a single bit but the sign: 0 times infinity must not become NaN, and NaN must stay
            if (bitcast<u32>(weight) << 1u) != 0u {
                total += weight * samples[place + channel * sizes.sample_step];
            }
        }
    }
    y[i] = total;
}
