// What is left behind all samples of rays, and its adjoint; one ray per invocation. Twin of src/backend/cpu/rays.rs.
#import "shared/linear.wgsl"

struct Sizes {
    rays: u32,
    // a ray ends where less than this is left
    stop: f32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> alpha: array<f32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read> g: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn left(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let ray = linear_group(group, groups) * WORKGROUP + local;
    if ray >= sizes.rays {
        return;
    }
    var left = 1.0;
    for (var k = offsets[ray]; k < offsets[ray + 1u]; k++) {
        left *= 1.0 - alpha[k];
        if left < sizes.stop {
            break;
        }
    }
    y[ray] = left;
}

@compute @workgroup_size(WORKGROUP)
fn slope(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let ray = linear_group(group, groups) * WORKGROUP + local;
    if ray >= sizes.rays {
        return;
    }
    let start = offsets[ray];
    var left = 1.0;
    var ended = false;
    var kept = start;
    for (var k = start; k < offsets[ray + 1u]; k++) {
        y[k] = select(left, 0.0, ended);
        if !ended {
            kept = k + 1u;
        }
        left *= 1.0 - alpha[k];
        ended = ended || left < sizes.stop;
    }
    // the cotangent times what is left behind each sample
    var behind = g[ray];
    for (var k = kept; k > start; k--) {
        y[k - 1u] *= -behind;
        behind *= 1.0 - alpha[k - 1u];
    }
}
