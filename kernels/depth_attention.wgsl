// Attention over the depth samples of each pixel, and what its adjoint is made of. Pixels are neighbours in memory and
// among invocations.
#import "shared/linear.wgsl"
#import "shared/is_nan.wgsl"
#import "shared/exp.wgsl"

// Twin of DepthAttention::words.
struct Sizes {
    heads: u32,
    channels: u32,
    depths: u32,
    pixels: u32,
    // bits of an f32
    scale: u32,
    // heads of a map for each head of a volume
    shared_by: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
// [heads, channels, pixels]
@group(0) @binding(2) var<storage, read> map: array<f32>;
// [heads / shared_by, channels, depths, pixels]
@group(0) @binding(3) var<storage, read> volume: array<f32>;
// [heads, depths, pixels]
@group(0) @binding(4) var<storage, read> weights: array<f32>;

const LOWEST: f32 = -3.4028234e38;

// sum over channels of map and volume at one depth
fn product(head: u32, depth: u32, pixel: u32) -> f32 {
    var sum = 0.0;
    let of_map = head * sizes.channels;
    let of_volume = head / sizes.shared_by * sizes.channels;
    for (var c = 0u; c < sizes.channels; c++) {
        let row = (of_volume + c) * sizes.depths + depth;
        sum += map[(of_map + c) * sizes.pixels + pixel] * volume[row * sizes.pixels + pixel];
    }
    return sum;
}

// The weights of a pixel's depths; zeros where all scores are -inf.
@compute @workgroup_size(WORKGROUP)
fn softmax(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.heads * sizes.pixels {
        return;
    }
    let head = i / sizes.pixels;
    let pixel = i % sizes.pixels;
    let start = head * sizes.depths * sizes.pixels + pixel;
    let end = start + sizes.depths * sizes.pixels;
    var largest = LOWEST;
    for (var depth = 0u; depth < sizes.depths; depth++) {
        let score = product(head, depth, pixel) * bitcast<f32>(sizes.scale);
        y[start + depth * sizes.pixels] = score;
        largest = max(largest, score);
    }
    var sum = 0.0;
    for (var at = start; at < end; at += sizes.pixels) {
        let weight = scalar_exp(y[at] - largest);
        y[at] = weight;
        sum += weight;
    }
    let factor = select(1.0 / sum, 0.0, sum == 0.0);
    for (var at = start; at < end; at += sizes.pixels) {
        y[at] *= factor;
    }
}

// The cotangents of a pixel's scores, before the scale; map and volume are the cotangent of the result and the values.
@compute @workgroup_size(WORKGROUP)
fn slopes(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.heads * sizes.pixels {
        return;
    }
    let head = i / sizes.pixels;
    let pixel = i % sizes.pixels;
    let start = head * sizes.depths * sizes.pixels + pixel;
    let end = start + sizes.depths * sizes.pixels;
    var mean = 0.0;
    for (var depth = 0u; depth < sizes.depths; depth++) {
        let at = start + depth * sizes.pixels;
        let slope = product(head, depth, pixel);
        y[at] = slope;
        mean += weights[at] * slope;
    }
    for (var at = start; at < end; at += sizes.pixels) {
        y[at] = weights[at] * (y[at] - mean) * bitcast<f32>(sizes.scale);
    }
}

// A map from a volume: the sum over depths with the weights.
@compute @workgroup_size(WORKGROUP)
fn mix(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.heads * sizes.channels * sizes.pixels {
        return;
    }
    let channel = i / sizes.pixels;
    let pixel = i % sizes.pixels;
    let head = channel / sizes.channels;
    let row = (head / sizes.shared_by * sizes.channels + channel % sizes.channels) * sizes.depths;
    var sum = 0.0;
    for (var depth = 0u; depth < sizes.depths; depth++) {
        let weight = weights[(head * sizes.depths + depth) * sizes.pixels + pixel];
        sum += weight * volume[(row + depth) * sizes.pixels + pixel];
    }
    y[i] = sum;
}

// A volume from a map: its product with the weights at every depth, summed over the heads that share it.
@compute @workgroup_size(WORKGROUP)
fn spread(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.heads / sizes.shared_by * sizes.channels * sizes.depths * sizes.pixels {
        return;
    }
    let pixel = i % sizes.pixels;
    let depth = i / sizes.pixels % sizes.depths;
    let row = i / sizes.pixels / sizes.depths;
    let channel = row % sizes.channels;
    let first = row / sizes.channels * sizes.shared_by;
    var sum = 0.0;
    for (var head = first; head < first + sizes.shared_by; head++) {
        let weight = weights[(head * sizes.depths + depth) * sizes.pixels + pixel];
        sum += weight * map[(head * sizes.channels + channel) * sizes.pixels + pixel];
    }
    y[i] = sum;
}
