// The adjoint of the material: turns the cotangents of F, of the affine matrix and of history after the substep into those
// before it, and adds to those of mass and parameters. The host puts the law in (src/physics/gpu/law.rs).
@group(0) @binding(2) var<storage, read_write> cotangent: array<f32>;
@group(0) @binding(3) var<storage, read_write> on_values: array<f32>;
@group(0) @binding(4) var<storage, read> now: array<f32>;
@group(0) @binding(5) var<storage, read> values: array<u32>;
// of the affine matrix, row by row, and of the mass through the transfers
@group(0) @binding(6) var<storage, read> on_record: array<f32>;
#import "program"

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i < substep.count {
        pull_back(substep.first + i, i);
    }
}
