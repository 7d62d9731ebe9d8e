// Copies one operand of a concatenation to its place in the result, as bits. One dispatch per operand.
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
    // elements of x and of y for each index of the axes before the joined one, and where those of x begin
    x_row: u32,
    y_row: u32,
    start: u32,
    // where x and y are windows, the numbers of their first elements
    x_first: u32,
    y_first: u32,
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
    let number = sizes.x_first + i;
    // a place in front of the window wraps around to a large number
    let place = number / sizes.x_row * sizes.y_row + sizes.start + number % sizes.x_row - sizes.y_first;
    if place < arrayLength(&y) {
        y[place] = x[i];
    }
}
