// One number for each row at the place that an index names, among zeros. Elements are copied as bits.
#import "shared/linear.wgsl"

// Twin of Put::groups. Axes hold size, step in the rows and step in the numbers of the index.
struct Layout {
    len: u32,
    rank: u32,
    // where y and the rows are windows, the numbers of their first elements
    y_first: u32,
    row_first: u32,
    axes: array<vec4<u32>, 8>,
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
    var rest = sizes.y_first + i;
    // a row in front of the window wraps around to a large number
    var row = 0u - sizes.row_first;
    var number = 0u;
    for (var axis = sizes.rank; axis > 0u; axis--) {
        let extent = sizes.axes[axis - 1u];
        row += rest % extent.x * extent.y;
        number += rest % extent.x * extent.z;
        rest /= extent.x;
    }
    if row < arrayLength(&index) {
        y[i] = select(0u, x[row], index[row] == number);
    }
}
