// Softmax along an axis, its logarithm, and the adjoint of the softmax.
//
// `lines` gives each row or column to one invocation, `groups` to one workgroup, which is meant for long rows whose
// elements are neighbours. Maxima start at the lowest finite number, so that a row of nothing but -inf has exponentials of
// 0, and a NaN that a maximum has passed over comes back in the sum.
#import "shared/linear.wgsl"
#import "shared/is_nan.wgsl"
#import "shared/exp.wgsl"
#import "shared/ln.wgsl"
#import "shared/sum_of_group.wgsl"

struct Sizes {
    // rows or columns
    count: u32,
    // elements of each
    len: u32,
    // distance between them
    inner: u32,
    // whether the logarithm is wanted
    log: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read> g: array<f32>;

const LOWEST: f32 = -3.4028234e38;

fn start_of(line: u32) -> u32 {
    return line / sizes.inner * sizes.len * sizes.inner + line % sizes.inner;
}

// The result from the largest element and the sum of the exponentials.
fn finished(value: f32, largest: f32, sum: f32) -> f32 {
    if sizes.log != 0u {
        return value - largest - select(scalar_ln(sum), 0.0, sum == 0.0);
    }
    return scalar_exp(value - largest) * select(1.0 / sum, 0.0, sum == 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn lines(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let line = linear_group(group, groups) * WORKGROUP + local;
    if line >= sizes.count {
        return;
    }
    let start = start_of(line);
    var largest = LOWEST;
    for (var i = 0u; i < sizes.len; i++) {
        largest = max(largest, x[start + i * sizes.inner]);
    }
    var sum = 0.0;
    for (var i = 0u; i < sizes.len; i++) {
        sum += scalar_exp(x[start + i * sizes.inner] - largest);
    }
    for (var i = 0u; i < sizes.len; i++) {
        y[start + i * sizes.inner] = finished(x[start + i * sizes.inner], largest, sum);
    }
}

@compute @workgroup_size(WORKGROUP)
fn adjoint_lines(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let line = linear_group(group, groups) * WORKGROUP + local;
    if line >= sizes.count {
        return;
    }
    let start = start_of(line);
    var mean = 0.0;
    for (var i = 0u; i < sizes.len; i++) {
        mean += x[start + i * sizes.inner] * g[start + i * sizes.inner];
    }
    for (var i = 0u; i < sizes.len; i++) {
        y[start + i * sizes.inner] = x[start + i * sizes.inner] * (g[start + i * sizes.inner] - mean);
    }
}

// The largest number of a workgroup; every invocation must call it.
fn largest_of_group(local: u32, part: f32) -> f32 {
    parts_of_sum[local] = part;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            parts_of_sum[local] = max(parts_of_sum[local], parts_of_sum[local + half]);
        }
    }
    workgroupBarrier();
    return parts_of_sum[0];
}

@compute @workgroup_size(WORKGROUP)
fn groups(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let line = linear_group(group, groups);
    if line >= sizes.count {
        return;
    }
    let start = start_of(line);
    var part = LOWEST;
    for (var i = local; i < sizes.len; i += WORKGROUP) {
        part = max(part, x[start + i * sizes.inner]);
    }
    let largest = largest_of_group(local, part);
    part = 0.0;
    for (var i = local; i < sizes.len; i += WORKGROUP) {
        part += scalar_exp(x[start + i * sizes.inner] - largest);
    }
    let sum = sum_of_group(local, part);
    for (var i = local; i < sizes.len; i += WORKGROUP) {
        y[start + i * sizes.inner] = finished(x[start + i * sizes.inner], largest, sum);
    }
}

@compute @workgroup_size(WORKGROUP)
fn adjoint_groups(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let line = linear_group(group, groups);
    if line >= sizes.count {
        return;
    }
    let start = start_of(line);
    var part = 0.0;
    for (var i = local; i < sizes.len; i += WORKGROUP) {
        part += x[start + i * sizes.inner] * g[start + i * sizes.inner];
    }
    let mean = sum_of_group(local, part);
    for (var i = local; i < sizes.len; i += WORKGROUP) {
        y[start + i * sizes.inner] = x[start + i * sizes.inner] * (g[start + i * sizes.inner] - mean);
    }
}
