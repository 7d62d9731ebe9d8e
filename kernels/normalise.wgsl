// Group norm and layer norm: runs of `len` elements are brought to mean 0 and variance 1, then scaled and shifted.
//
// The mean is kept as a sum of two numbers: that of a first pass, and the mean distance to it. With the normalised n, the
// cotangent c of z = scale n + shift and means over the run, the adjoint is
// (scale c - mean(scale c) - n mean(scale c n)) / deviation.
#import "shared/linear.wgsl"
#import "shared/is_nan.wgsl"
#import "shared/exp.wgsl"
#import "shared/logistic.wgsl"
#import "shared/sum_of_group.wgsl"

// Twin of Normalise::sizes.
struct Sizes {
    // elements of all runs, number of runs, elements of one
    total: u32,
    groups: u32,
    len: u32,
    // element i has the parameters with number i / inner % parameters
    inner: u32,
    parameters: u32,
    // whether there are parameters, and whether z logistic(z) is wanted in place of z
    affine: u32,
    silu: u32,
    // bits of an f32
    epsilon: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
// mean in two parts and reciprocal deviation of each run
@group(0) @binding(3) var<storage, read> runs: array<f32>;
@group(0) @binding(4) var<storage, read> scale: array<f32>;
@group(0) @binding(5) var<storage, read> shift: array<f32>;
@group(0) @binding(6) var<storage, read> g: array<f32>;
// the two means of the adjoint for each run
@group(0) @binding(7) var<storage, read> means: array<f32>;

// Writes mean in two parts and reciprocal deviation of a run to y.
@compute @workgroup_size(WORKGROUP)
fn statistics(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let run = linear_group(group, groups);
    if run >= sizes.groups {
        return;
    }
    let count = f32(sizes.len);
    var part = 0.0;
    for (var i = local; i < sizes.len; i += WORKGROUP) {
        part += x[run * sizes.len + i];
    }
    let near = sum_of_group(local, part) / count;
    part = 0.0;
    var squares = 0.0;
    for (var i = local; i < sizes.len; i += WORKGROUP) {
        let d = x[run * sizes.len + i] - near;
        part += d;
        squares += d * d;
    }
    let rest = sum_of_group(local, part) / count;
    let variance = sum_of_group(local, squares) / count - rest * rest;
    if local == 0u {
        y[3u * run] = near;
        y[3u * run + 1u] = rest;
        y[3u * run + 2u] = 1.0 / sqrt(variance + bitcast<f32>(sizes.epsilon));
    }
}

fn normalised(i: u32) -> f32 {
    let run = i / sizes.len;
    return (x[i] - runs[3u * run] - runs[3u * run + 1u]) * runs[3u * run + 2u];
}

fn parameter_of(i: u32) -> u32 {
    return i / sizes.inner % sizes.parameters;
}

fn scale_of(i: u32) -> f32 {
    if sizes.affine == 0u {
        return 1.0;
    }
    return scale[parameter_of(i)];
}

// z of the normalised element n.
fn scaled(i: u32, n: f32) -> f32 {
    if sizes.affine == 0u {
        return n;
    }
    return n * scale[parameter_of(i)] + shift[parameter_of(i)];
}

// The cotangent of z.
fn cotangent(i: u32, n: f32) -> f32 {
    if sizes.silu == 0u {
        return g[i];
    }
    let z = scaled(i, n);
    let s = scalar_logistic(z);
    return g[i] * (s + s * z * (1.0 - s));
}

@compute @workgroup_size(WORKGROUP)
fn forward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.total {
        return;
    }
    let z = scaled(i, normalised(i));
    if sizes.silu == 0u {
        y[i] = z;
    } else {
        y[i] = z * scalar_logistic(z);
    }
}

// Writes mean(scale c) and mean(scale c n) of a run to y.
@compute @workgroup_size(WORKGROUP)
fn cotangent_means(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let run = linear_group(group, groups);
    if run >= sizes.groups {
        return;
    }
    var part = 0.0;
    var products = 0.0;
    for (var place = local; place < sizes.len; place += WORKGROUP) {
        let i = run * sizes.len + place;
        let n = normalised(i);
        let c = scale_of(i) * cotangent(i, n);
        part += c;
        products += c * n;
    }
    let first = sum_of_group(local, part) / f32(sizes.len);
    let second = sum_of_group(local, products) / f32(sizes.len);
    if local == 0u {
        y[2u * run] = first;
        y[2u * run + 1u] = second;
    }
}

@compute @workgroup_size(WORKGROUP)
fn backward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.total {
        return;
    }
    let run = i / sizes.len;
    let n = normalised(i);
    let centred = scale_of(i) * cotangent(i, n) - means[2u * run];
    y[i] = (centred - n * means[2u * run + 1u]) * runs[3u * run + 2u];
}

// Writes the cotangents of a scale and of the shift with the same number to y: all scales first.
@compute @workgroup_size(WORKGROUP)
fn parameter_sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let parameter = linear_group(group, groups);
    if parameter >= sizes.parameters {
        return;
    }
    var shifts = 0.0;
    var scales = 0.0;
    for (var place = local; place < sizes.total / sizes.parameters; place += WORKGROUP) {
        let i = (place / sizes.inner * sizes.parameters + parameter) * sizes.inner + place % sizes.inner;
        let n = normalised(i);
        let c = cotangent(i, n);
        shifts += c;
        scales += c * n;
    }
    let for_scale = sum_of_group(local, scales);
    let for_shift = sum_of_group(local, shifts);
    if local == 0u {
        y[parameter] = for_scale;
        y[sizes.parameters + parameter] = for_shift;
    }
}
