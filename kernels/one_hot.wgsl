// 1 at the places that indices name, 0 elsewhere.
#import "shared/linear.wgsl"

// Twin of OneHot::groups. Axes hold size, step in the index tensor and step in the numbers it holds.
struct Layout {
    len: u32,
    rank: u32,
    axes: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> sizes: Layout;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> index: array<u32>;

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
    var rest = i;
    var row = 0u;
    var number = 0u;
    for (var axis = sizes.rank; axis > 0u; axis--) {
        let extent = sizes.axes[axis - 1u];
        row += rest % extent.x * extent.y;
        number += rest % extent.x * extent.z;
        rest /= extent.x;
    }
    y[i] = select(0.0, 1.0, index[row] == number);
}
