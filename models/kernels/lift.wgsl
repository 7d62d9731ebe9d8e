// What the adjoint of grid-to-particle scatters: the record of gv + dt gx and 4/dx² gc, after the records of all particles.
@group(0) @binding(2) var<storage, read_write> records: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> cotangent: array<f32>;
@group(0) @binding(4) var<storage, read> slots: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p >= substep.particles {
        return;
    }
    let four = 4.0 * substep.inverse_dx * substep.inverse_dx;
    let here = 4u * slots[p];
    let to = 4u * substep.particles + here;
    var on_v = vec3<f32>(0.0);
    for (var axis = 0u; axis < 3u; axis++) {
        on_v[axis] = cotangent[place(V + axis, p)] + substep.dt * cotangent[place(axis, p)];
        let column = vec3<f32>(
            cotangent[place(C + axis, p)], cotangent[place(C + 3u + axis, p)], cotangent[place(C + 6u + axis, p)]
        );
        records[to + 1u + axis] = vec4<f32>(four * column, records[here + 1u + axis].w);
    }
    records[to] = vec4<f32>(on_v, 0.0);
}
