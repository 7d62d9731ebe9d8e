// Along one axis, each place of y is a weighted sum of a few places of x: those of places[starts[r] .. starts[r + 1]].
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
    // elements behind the axis
    inner: u32,
    // size of the axis of y and of x
    rows: u32,
    columns: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> places: array<u32>;
@group(0) @binding(5) var<storage, read> weights: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.len {
        return;
    }
    let row = i / sizes.inner % sizes.rows;
    let first = i / (sizes.inner * sizes.rows) * sizes.columns * sizes.inner + i % sizes.inner;
    var total = 0.0;
    for (var k = starts[row]; k < starts[row + 1u]; k++) {
        total += x[first + places[k] * sizes.inner] * weights[k];
    }
    y[i] = total;
}
