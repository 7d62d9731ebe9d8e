// From each row the element at the place that an index names, copied as bits.
#import "shared/linear.wgsl"

// Twin of Take::forward_gpu. Axes hold size and step; the outermost comes first.
struct Layout {
    len: u32,
    kept_rank: u32,
    dropped_rank: u32,
    // where y and x are windows, the numbers of their first elements
    y_first: u32,
    x_first: u32,
    kept: array<vec4<u32>, 8>,
    dropped: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> sizes: Layout;
@group(0) @binding(1) var<storage, read_write> y: array<u32>;
@group(0) @binding(2) var<storage, read> x: array<u32>;
@group(0) @binding(3) var<storage, read> index: array<u32>;

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
    // a place in front of the window wraps around to a large number
    var place = 0u - sizes.x_first;
    var rest = sizes.y_first + i;
    for (var axis = sizes.kept_rank; axis > 0u; axis--) {
        let extent = sizes.kept[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    rest = index[i];
    for (var axis = sizes.dropped_rank; axis > 0u; axis--) {
        let extent = sizes.dropped[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    if place < arrayLength(&x) {
        y[i] = x[place];
    }
}
