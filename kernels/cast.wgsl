// Between f32 and f16 stored two to a word. By bits: the built-in packing leaves infinities, NaN and what is too large
// to the driver.
#import "shared/linear.wgsl"

struct Sizes {
    len: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;

@group(0) @binding(1) var<storage, read_write> wide: array<f32>;
@group(0) @binding(2) var<storage, read> narrow_f16: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn widen(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.len {
        return;
    }
    let half = (narrow_f16[i / 2u] >> (16u * (i % 2u))) & 0xffffu;
    let sign = (half & 0x8000u) << 16u;
    let exponent = (half >> 10u) & 0x1fu;
    let mantissa = half & 0x3ffu;
    var bits = 0u;
    if exponent == 0u {
        // below the normal numbers: steps of 2^-24
        bits = bitcast<u32>(f32(mantissa) * 5.9604644775390625e-8);
    } else if exponent == 31u {
        bits = 0x7f800000u | (mantissa << 13u);
    } else {
        bits = ((exponent + 112u) << 23u) | (mantissa << 13u);
    }
    wide[i] = bitcast<f32>(sign | bits);
}

@group(0) @binding(3) var<storage, read_write> result_f16: array<u32>;
@group(0) @binding(4) var<storage, read> x: array<f32>;

// x / 2^places, rounded to the nearest, on a tie to the even one.
fn rounded(value: u32, places: u32) -> u32 {
    let cut = value >> places;
    let rest = value & ((1u << places) - 1u);
    let middle = 1u << (places - 1u);
    if rest > middle || (rest == middle && (cut & 1u) == 1u) {
        return cut + 1u;
    }
    return cut;
}

fn half_bits(value: f32) -> u32 {
    let bits = bitcast<u32>(value);
    let sign = (bits >> 16u) & 0x8000u;
    let size = bits & 0x7fffffffu;
    if size > 0x7f800000u {
        return sign | 0x7e00u;
    }
    // from 65520 on the nearest is infinity
    if size >= 0x477ff000u {
        return sign | 0x7c00u;
    }
    let exponent = size >> 23u;
    // below 2^-14, the smallest normal number: steps of 2^-24
    if exponent < 113u {
        if exponent < 102u {
            return sign;
        }
        return sign | rounded((size & 0x7fffffu) | 0x800000u, 126u - exponent);
    }
    // rounding may carry into the exponent, as it should
    return sign | rounded(size - (112u << 23u), 13u);
}

@compute @workgroup_size(WORKGROUP)
fn narrow(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pair = linear_group(group, groups) * WORKGROUP + local;
    let i = 2u * pair;
    if i >= sizes.len {
        return;
    }
    var word = half_bits(x[i]);
    if i + 1u < sizes.len {
        word |= half_bits(x[i + 1u]) << 16u;
    }
    result_f16[pair] = word;
}
