// Random numbers from a key and a counter: the generator of src/random/mod.rs, in which numbers of 64 bits are pairs of
// words, the lower one first.
//
// The program is the quantile function of the normal distribution (src/random/normal.rs).
#import "shared/linear.wgsl"
#import "program"

struct Sizes {
    len: u32,
    key_low: u32,
    key_high: u32,
    // 1: standard normal, 0: uniform in [0, 1)
    normal: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;

// The upper word of a product.
fn upper(a: u32, b: u32) -> u32 {
    let low = (a & 0xffffu) * (b & 0xffffu);
    let left = (a >> 16u) * (b & 0xffffu);
    let right = (a & 0xffffu) * (b >> 16u);
    let middle = (low >> 16u) + (left & 0xffffu) + (right & 0xffffu);
    return (a >> 16u) * (b >> 16u) + (left >> 16u) + (right >> 16u) + (middle >> 16u);
}

fn times(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return vec2(a.x * b.x, upper(a.x, b.x) + a.x * b.y + a.y * b.x);
}

fn plus(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2(low, a.y + b.y + select(0u, 1u, low < a.x));
}

// x ^ (x >> by) for 0 < by < 32
fn folded(x: vec2<u32>, by: u32) -> vec2<u32> {
    return x ^ vec2((x.x >> by) | (x.y << (32u - by)), x.y >> by);
}

// Twin of Key::bits.
fn bits(counter: u32) -> vec2<u32> {
    let golden = vec2(0x7f4a7c15u, 0x9e3779b9u);
    var z = plus(vec2(sizes.key_low, sizes.key_high), times(vec2(counter, 0u), golden));
    z = plus(z, golden);
    z = times(folded(z, 30u), vec2(0x1ce4e5b9u, 0xbf58476du));
    z = times(folded(z, 27u), vec2(0x133111ebu, 0x94d049bbu));
    return folded(z, 31u);
}

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
    let random = bits(i);
    if sizes.normal == 0u {
        y[i] = f32(random.y >> 8u) * 5.9604645e-8;
        return;
    }
    // twin of normal::fill: one bit for the sign, 63 for the probability
    let high = (random.y << 1u) | (random.x >> 31u);
    let low = random.x << 1u;
    let p = f32(high) * 1.1641532e-10 + (f32(low) + 0.5) * 2.7105054e-20;
    y[i] = normal_quantile(select(p, -p, (random.y >> 31u) == 1u));
}
