// The material of some particles: trial deformation, return map, stress, and what each of them scatters. The host puts the
// law in (src/physics/gpu/law.rs).
@group(0) @binding(2) var<storage, read_write> next: array<f32>;
@group(0) @binding(3) var<storage, read_write> records: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> now: array<f32>;
@group(0) @binding(5) var<storage, read> slots: array<u32>;
@group(0) @binding(6) var<storage, read> values: array<u32>;
#import "program"

fn all_finite(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    let node_grid = node_grid_now();
    if i >= substep.count || !node_grid.sound || !node_grid.fits {
        return;
    }
    let p = substep.first + i;
    let mass = value(0u, i);
    var a = respond(p, i);
    let q = mass * vec3<f32>(now[place(V, p)], now[place(V + 1u, p)], now[place(V + 2u, p)]);
    if !(all_finite(q) && all_finite(a[0]) && all_finite(a[1]) && all_finite(a[2])) {
        atomicMin(&marks[mark_of(substep.step, CULPRIT)], p);
    }
    let at = 4u * slots[p];
    records[at] = vec4<f32>(q, mass);
    for (var axis = 0u; axis < 3u; axis++) {
        records[at + 1u + axis] = vec4<f32>(a[axis], now[place(axis, p)]);
    }
}
