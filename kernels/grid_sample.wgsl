// Values of a regular grid at points, and how they change with the points.
#import "shared/linear.wgsl"
#import "shared/grid.wgsl"

@group(0) @binding(0) var<uniform> sizes: Grid;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> grid: array<f32>;
@group(0) @binding(3) var<storage, read> points: array<f32>;
@group(0) @binding(4) var<storage, read> samples: array<f32>;

var<private> hats: array<Hat, 3>;

// Finds the cell of a point; false where no node is near.
fn locate(point: u32) -> bool {
    var poison = 0.0;
    for (var axis = 0u; axis < sizes.rank; axis++) {
        let x = points[point * sizes.rank + axis];
        if !is_finite(x) {
            poison = x;
        }
    }
    var near = true;
    for (var axis = 0u; axis < sizes.rank; axis++) {
        let x = points[point * sizes.rank + sizes.axes[axis].z];
        hats[axis] = hat_of(axis, x, poison, sizes.corners == 1u, sizes.border == 1u, sizes.maps[axis]);
        near = near && hats[axis].near;
    }
    return near;
}

fn corner_node(corner: u32) -> u32 {
    var node = 0u;
    for (var axis = 0u; axis < sizes.rank; axis++) {
        let extent = sizes.axes[axis];
        node += node_of(hats[axis], side_of(corner, axis, sizes.rank) * u32(sizes.corners > 1u), extent.x) * extent.y;
    }
    return node;
}

@compute @workgroup_size(WORKGROUP)
fn sample(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.len {
        return;
    }
    let inner = i % (sizes.channels * sizes.count);
    let batch = i / (sizes.channels * sizes.count);
    // the smaller step runs fastest
    var channel = inner % sizes.channels;
    var point = inner / sizes.channels;
    if sizes.point_step == 1u && sizes.sample_step != 1u {
        channel = inner / sizes.count;
        point = inner % sizes.count;
    }
    var total = 0.0;
    if locate(batch * sizes.count + point) {
        let start = batch * sizes.channels * sizes.nodes + channel * sizes.value_step;
        for (var corner = 0u; corner < sizes.corners; corner++) {
            var weight = 1.0;
            for (var axis = 0u; axis < sizes.rank; axis++) {
                weight *= hats[axis].weight[side_of(corner, axis, sizes.rank)];
            }
            total += weight * grid[start + corner_node(corner) * sizes.node_step];
        }
    }
    y[i] = total;
}

@compute @workgroup_size(WORKGROUP)
fn slope(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p >= sizes.len {
        return;
    }
    var slopes = array<f32, 3>();
    if locate(p) {
        let batch = p / sizes.count;
        let here = batch * sizes.channels * sizes.count + p % sizes.count * sizes.point_step;
        for (var corner = 0u; corner < sizes.corners; corner++) {
            let node = batch * sizes.channels * sizes.nodes + corner_node(corner) * sizes.node_step;
            var product = 0.0;
            for (var c = 0u; c < sizes.channels; c++) {
                product += grid[node + c * sizes.value_step] * samples[here + c * sizes.sample_step];
            }
            for (var along = 0u; along < sizes.rank; along++) {
                var slope = product;
                for (var axis = 0u; axis < sizes.rank; axis++) {
                    let side = side_of(corner, axis, sizes.rank);
                    slope *= select(hats[axis].weight[side], hats[axis].slope[side], axis == along);
                }
                slopes[sizes.axes[along].z] += slope;
            }
        }
    }
    for (var component = 0u; component < sizes.rank; component++) {
        y[p * sizes.rank + component] = slopes[component];
    }
}
