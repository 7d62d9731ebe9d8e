// A scalar program applied to every element.
//
// The program comes from the host (src/ops/map.rs) with the bindings of its operands, x0, x1 and so on from binding 2,
// and `value`, which calls it for one element.
#import "shared/linear.wgsl"
#import "program"

struct Sizes {
    len: u32,
    // bit n: operand n has an element for each of the result, not one for all
    each: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;

// The place of element i in operand n.
fn place(i: u32, n: u32) -> u32 {
    return i * ((sizes.each >> n) & 1u);
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i < sizes.len {
        y[i] = value(i);
    }
}
