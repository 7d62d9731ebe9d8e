// The adjoint of both transfers, as seen from a particle; see `pull` in src/physics/transfer.rs. Positions and velocities of
// `cotangent` become those before the substep.
@group(0) @binding(2) var<storage, read_write> cotangent: array<f32>;
// of the affine matrix, row by row, and of the mass
@group(0) @binding(3) var<storage, read_write> on_record: array<f32>;
@group(0) @binding(4) var<storage, read> now: array<f32>;
@group(0) @binding(5) var<storage, read> slots: array<u32>;
@group(0) @binding(6) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> grid: array<vec4<f32>>;

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
    let node_grid = node_grid_now();
    let at = 4u * slots[p];
    let after = 4u * substep.particles + at;
    let q = records[at];
    var a = array<vec4<f32>, 3>(records[at + 1u], records[at + 2u], records[at + 3u]);
    let q2 = records[after];
    var a2 = array<vec4<f32>, 3>(records[after + 1u], records[after + 2u], records[after + 3u]);
    var s = stencil_of(node_grid, vec3<f32>(a[0].w, a[1].w, a[2].w));
    var sum = vec4<f32>(0.0);
    var velocity = vec3<f32>(0.0);
    var by_weights = vec3<f32>(0.0);
    var moment = array<vec3<f32>, 3>();
    for (var i = 0; i < 3; i++) {
        for (var j = 0; j < 3; j++) {
            let row = node_number(node_grid, s.cell + vec3<i32>(i, j, 0));
            for (var k = 0; k < 3; k++) {
                let v = grid[row + u32(k)].xyz;
                let g = grid[substep.capacity + row + u32(k)];
                let w = vec3<f32>(s.w[i].x, s.w[j].y, s.w[k].z);
                let delta = vec3<f32>(s.delta[i].x, s.delta[j].y, s.delta[k].z);
                let moved = q.xyz + a[0].xyz * delta.x + a[1].xyz * delta.y + a[2].xyz * delta.z;
                let lifted = q2.xyz + a2[0].xyz * delta.x + a2[1].xyz * delta.y + a2[2].xyz * delta.z;
                let work = dot(moved, g.xyz) + q.w * g.w + dot(lifted, v);
                by_weights += work * vec3<f32>(s.dw[i].x * w.y * w.z, w.x * s.dw[j].y * w.z, w.x * w.y * s.dw[k].z);
                let weighted = w.x * w.y * w.z * g;
                sum += weighted;
                velocity += w.x * w.y * w.z * v;
                moment[0] += weighted.xyz * delta.x;
                moment[1] += weighted.xyz * delta.y;
                moment[2] += weighted.xyz * delta.z;
            }
        }
    }
    var on_mass = sum.w;
    for (var axis = 0u; axis < 3u; axis++) {
        cotangent[place(axis, p)] += by_weights[axis] - dot(a[axis].xyz, sum.xyz) - dot(a2[axis].xyz, velocity);
        cotangent[place(V + axis, p)] = q.w * sum[axis];
        on_mass += now[place(V + axis, p)] * sum[axis];
        for (var column = 0u; column < 3u; column++) {
            on_record[place(3u * axis + column, p)] = moment[column][axis];
        }
    }
    on_record[place(9u, p)] = on_mass;
}
