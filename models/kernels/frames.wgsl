// Frames, [frames, n, 3] in the caller's order of particles: positions out of a state, cotangents into one.
@group(0) @binding(2) var<storage, read> labels: array<u32>;

@group(0) @binding(3) var<storage, read_write> frames: array<f32>;
@group(0) @binding(4) var<storage, read> now: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn show(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p < substep.particles {
        let at = 3u * (substep.frame * substep.particles + labels[p]);
        for (var axis = 0u; axis < 3u; axis++) {
            frames[at + axis] = now[place(axis, p)];
        }
    }
}

@group(0) @binding(5) var<storage, read_write> cotangent: array<f32>;
@group(0) @binding(6) var<storage, read> on_frames: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn add(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p < substep.particles {
        let at = 3u * (substep.frame * substep.particles + labels[p]);
        for (var axis = 0u; axis < 3u; axis++) {
            cotangent[place(axis, p)] += on_frames[at + axis];
        }
    }
}
