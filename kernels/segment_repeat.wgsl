// A row for each segment, repeated for the rows of it; copied as bits.
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
    // elements of a row
    row: u32,
    segments: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<u32>;
@group(0) @binding(2) var<storage, read> x: array<u32>;
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
    // the last segment that starts at this row or before it lies in low … high - 1
    let place = i / sizes.row;
    var low = 0u;
    var high = sizes.segments;
    while high - low > 1u {
        let middle = low + (high - low) / 2u;
        if offsets[middle] <= place {
            low = middle;
        } else {
            high = middle;
        }
    }
    y[i] = x[low * sizes.row + i % sizes.row];
}
