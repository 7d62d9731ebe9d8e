// Zeros before and after along one axis. Elements are copied as bits.
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
    // elements of x and of y for each index of the axes before the padded one, and zeros before those of x
    x_row: u32,
    y_row: u32,
    before: u32,
    // where y and x are windows, the numbers of their first elements
    y_first: u32,
    x_first: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
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
    let number = sizes.y_first + i;
    // wraps around to a large number in front of x
    let place = number % sizes.y_row - sizes.before;
    if place >= sizes.x_row {
        y[i] = 0u;
        return;
    }
    // and here in front of its window
    let source = number / sizes.y_row * sizes.x_row + place - sizes.x_first;
    if source < arrayLength(&x) {
        y[i] = x[source];
    }
}
