// y[i - first] = x[start + sum over axes of index * step]: the kernel of broadcast_to (some steps are 0), permute and slice.
// Where x is a window of the operand, elements outside of it are left as they are; `start` may be in front of it.
//
// Elements are copied as bits, so that any type of four bytes goes through unchanged, NaN included.
#import "shared/linear.wgsl"

// Twin of Strides in src/backend/gpu/strides.rs. Axes hold size and step; the outermost comes first.
struct Layout {
    len: u32,
    start: u32,
    rank: u32,
    // the number of the first element of y, where y is a part of the result
    first: u32,
    axes: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> sizes: Layout;
@group(0) @binding(1) var<storage, read_write> y: array<u32>;
@group(0) @binding(2) var<storage, read> x: array<u32>;

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
    var rest = sizes.first + i;
    var place = sizes.start;
    for (var axis = sizes.rank; axis > 0u; axis--) {
        let extent = sizes.axes[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    // a place in front of the window wraps around to a large number
    if place < arrayLength(&x) {
        y[i] = x[place];
    }
}
