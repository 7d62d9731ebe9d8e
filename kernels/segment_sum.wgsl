// Sums of neighbouring rows: sum s is that of the rows offsets[s] to before offsets[s + 1], in their order.
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
    // elements of a row
    row: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;

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
    let segment = i / sizes.row;
    let column = i % sizes.row;
    var total = 0.0;
    for (var k = offsets[segment]; k < offsets[segment + 1u]; k++) {
        total += x[k * sizes.row + column];
    }
    y[i] = total;
}
