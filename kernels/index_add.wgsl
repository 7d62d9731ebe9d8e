// Adds rows of x up by their numbers: row r of y is the sum of the rows order[starts[r]] to order[starts[r + 1]] of x.
//
// The host has sorted the rows by number, so that each element is written once: no atomics, the same bits every time.
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
    // elements of a row
    row: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> order: array<u32>;

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
    let r = i / sizes.row;
    let column = i % sizes.row;
    var total = 0.0;
    for (var k = starts[r]; k < starts[r + 1u]; k++) {
        total += x[order[k] * sizes.row + column];
    }
    y[i] = total;
}
