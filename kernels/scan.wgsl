// First-order recurrences along the middle axis of [outer, len, inner], one line for each invocation: running sums, and
// y[i] = a[i] y[i - 1] + b[i] from y[0] = b[0].
#import "shared/linear.wgsl"

// Twin of src/ops/cumsum.rs and src/ops/recurrence.rs.
struct Sizes {
    lines: u32,
    len: u32,
    inner: u32,
    // 1: from the end to the beginning
    reverse: u32,
}

// Terms of a running sum that are added to each other before they are added to the sum, which keeps digits.
const BLOCK: u32 = 32u;

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> a: array<f32>;
@group(0) @binding(3) var<storage, read> b: array<f32>;

// Where element `step` of a line lies.
fn place(line: u32, step: u32) -> u32 {
    let along = select(step, sizes.len - 1u - step, sizes.reverse == 1u);
    return (line / sizes.inner * sizes.len + along) * sizes.inner + line % sizes.inner;
}

@compute @workgroup_size(WORKGROUP)
fn cumsum(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let line = linear_group(group, groups) * WORKGROUP + local;
    if line >= sizes.lines {
        return;
    }
    var total = 0.0;
    for (var block = 0u; block < sizes.len; block += BLOCK) {
        var part = 0.0;
        for (var step = block; step < min(block + BLOCK, sizes.len); step++) {
            let at = place(line, step);
            part += b[at];
            y[at] = total + part;
        }
        total += part;
    }
}

@compute @workgroup_size(WORKGROUP)
fn recurrence(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let line = linear_group(group, groups) * WORKGROUP + local;
    if line >= sizes.lines || sizes.len == 0u {
        return;
    }
    var at = place(line, 0u);
    var state = b[at];
    y[at] = state;
    for (var step = 1u; step < sizes.len; step++) {
        at = place(line, step);
        state = a[at] * state + b[at];
        y[at] = state;
    }
}
