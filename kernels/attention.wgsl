// Scaled-dot-product attention and its adjoints without the matrix of scores.
//
// A workgroup works on one query, or for the cotangents of keys and values on one key. It goes through blocks of as many
// partners as it has invocations: each computes the weight of one partner, then each adds up its own channels over the
// block. Weights are recomputed from the kept logarithms of the sums of exponentials. Maxima start at the lowest finite
// number, so that a query whose keys are all masked has no weights.
#import "shared/linear.wgsl"
#import "shared/is_nan.wgsl"
#import "shared/exp.wgsl"
#import "shared/ln.wgsl"
#import "shared/sum_of_group.wgsl"

// Twin of Attention::sizes.
struct Sizes {
    heads: u32,
    queries: u32,
    keys: u32,
    // of queries and keys; of values
    channels: u32,
    values: u32,
    // bits of an f32
    scale: u32,
    masked: u32,
    // steps through the mask; `inner` heads make one outer step
    inner: u32,
    mask_outer: u32,
    mask_inner: u32,
    mask_query: u32,
    mask_key: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> q: array<f32>;
@group(0) @binding(3) var<storage, read> k: array<f32>;
@group(0) @binding(4) var<storage, read> v: array<f32>;
@group(0) @binding(5) var<storage, read> mask: array<f32>;
// of each query: logarithm of its sum of exponentials, and for the adjoints sum(g y)
@group(0) @binding(6) var<storage, read> log_sums: array<f32>;
@group(0) @binding(7) var<storage, read> g: array<f32>;
@group(0) @binding(8) var<storage, read> means: array<f32>;

const LOWEST: f32 = -3.4028234e38;

var<workgroup> weights: array<f32, WORKGROUP>;

// The score of a query's and a key's row.
fn score(query: u32, key: u32) -> f32 {
    var sum = 0.0;
    for (var c = 0u; c < sizes.channels; c++) {
        sum += q[query * sizes.channels + c] * k[key * sizes.channels + c];
    }
    sum *= bitcast<f32>(sizes.scale);
    if sizes.masked != 0u {
        let head = query / sizes.queries;
        sum += mask[head / sizes.inner * sizes.mask_outer + head % sizes.inner * sizes.mask_inner
            + query % sizes.queries * sizes.mask_query + key % sizes.keys * sizes.mask_key];
    }
    return sum;
}

// The share of a key in a query's result; nothing where no key counts, which is kept as the lowest number.
fn weight(query: u32, key: u32) -> f32 {
    let kept = log_sums[query];
    if kept == LOWEST {
        return 0.0;
    }
    return scalar_exp(score(query, key) - kept);
}

// The cotangent of the score.
fn slope(query: u32, key: u32) -> f32 {
    var sum = 0.0;
    for (var c = 0u; c < sizes.values; c++) {
        sum += g[query * sizes.values + c] * v[key * sizes.values + c];
    }
    return weight(query, key) * (sum - means[query]);
}

@compute @workgroup_size(WORKGROUP)
fn sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let query = linear_group(group, groups);
    if query >= sizes.heads * sizes.queries {
        return;
    }
    let first = query / sizes.queries * sizes.keys;
    var largest = LOWEST;
    var part = 0.0;
    for (var j = local; j < sizes.keys; j += WORKGROUP) {
        let s = score(query, first + j);
        let higher = max(largest, s);
        part = part * scalar_exp(largest - higher) + scalar_exp(s - higher);
        largest = higher;
    }
    weights[local] = largest;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            weights[local] = max(weights[local], weights[local + half]);
        }
    }
    workgroupBarrier();
    let highest = weights[0];
    let sum = sum_of_group(local, part * scalar_exp(largest - highest));
    if local == 0u {
        y[query] = select(highest + scalar_ln(sum), LOWEST, sum == 0.0);
    }
}

@compute @workgroup_size(WORKGROUP)
fn forward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let query = linear_group(group, groups);
    if query >= sizes.heads * sizes.queries {
        return;
    }
    let first = query / sizes.queries * sizes.keys;
    for (var c = local; c < sizes.values; c += WORKGROUP) {
        y[query * sizes.values + c] = 0.0;
    }
    for (var block = 0u; block < sizes.keys; block += WORKGROUP) {
        let count = min(WORKGROUP, sizes.keys - block);
        workgroupBarrier();
        if local < count {
            weights[local] = weight(query, first + block + local);
        }
        workgroupBarrier();
        for (var c = local; c < sizes.values; c += WORKGROUP) {
            var sum = 0.0;
            for (var j = 0u; j < count; j++) {
                sum += weights[j] * v[(first + block + j) * sizes.values + c];
            }
            y[query * sizes.values + c] += sum;
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn for_queries(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let query = linear_group(group, groups);
    if query >= sizes.heads * sizes.queries {
        return;
    }
    let first = query / sizes.queries * sizes.keys;
    for (var c = local; c < sizes.channels; c += WORKGROUP) {
        y[query * sizes.channels + c] = 0.0;
    }
    for (var block = 0u; block < sizes.keys; block += WORKGROUP) {
        let count = min(WORKGROUP, sizes.keys - block);
        workgroupBarrier();
        if local < count {
            weights[local] = slope(query, first + block + local) * bitcast<f32>(sizes.scale);
        }
        workgroupBarrier();
        for (var c = local; c < sizes.channels; c += WORKGROUP) {
            var sum = 0.0;
            for (var j = 0u; j < count; j++) {
                sum += weights[j] * k[(first + block + j) * sizes.channels + c];
            }
            y[query * sizes.channels + c] += sum;
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn for_keys(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let key = linear_group(group, groups);
    if key >= sizes.heads * sizes.keys {
        return;
    }
    let first = key / sizes.keys * sizes.queries;
    for (var c = local; c < sizes.channels; c += WORKGROUP) {
        y[key * sizes.channels + c] = 0.0;
    }
    for (var block = 0u; block < sizes.queries; block += WORKGROUP) {
        let count = min(WORKGROUP, sizes.queries - block);
        workgroupBarrier();
        if local < count {
            weights[local] = slope(first + block + local, key) * bitcast<f32>(sizes.scale);
        }
        workgroupBarrier();
        for (var c = local; c < sizes.channels; c += WORKGROUP) {
            var sum = 0.0;
            for (var i = 0u; i < count; i++) {
                sum += weights[i] * q[(first + block + i) * sizes.channels + c];
            }
            y[key * sizes.channels + c] += sum;
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn for_values(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let key = linear_group(group, groups);
    if key >= sizes.heads * sizes.keys {
        return;
    }
    let first = key / sizes.keys * sizes.queries;
    for (var c = local; c < sizes.values; c += WORKGROUP) {
        y[key * sizes.values + c] = 0.0;
    }
    for (var block = 0u; block < sizes.queries; block += WORKGROUP) {
        let count = min(WORKGROUP, sizes.queries - block);
        workgroupBarrier();
        if local < count {
            weights[local] = weight(first + block + local, key);
        }
        workgroupBarrier();
        for (var c = local; c < sizes.values; c += WORKGROUP) {
            var sum = 0.0;
            for (var i = 0u; i < count; i++) {
                sum += weights[i] * g[(first + block + i) * sizes.values + c];
            }
            y[key * sizes.values + c] += sum;
        }
    }
}

// The cotangents of all scores, for the mask.
@compute @workgroup_size(WORKGROUP)
fn for_scores(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.heads * sizes.queries * sizes.keys {
        return;
    }
    let query = i / sizes.keys;
    y[i] = slope(query, query / sizes.queries * sizes.keys + i % sizes.keys);
}
