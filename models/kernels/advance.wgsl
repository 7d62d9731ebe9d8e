// Grid to particle: velocity, affine velocity and position after the substep, and which cells the next one needs.
@group(0) @binding(2) var<storage, read> now: array<f32>;
@group(0) @binding(3) var<storage, read> grid: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> next: array<f32>;

// Widens the box of a substep by the cell of a particle. Few particles are outside what is known already.
fn widen(step: u32, x: vec3<f32>) {
    let cell = vec3<u32>(free_cell(x) + BIAS);
    for (var axis = 0u; axis < 3u; axis++) {
        let low = mark_of(step, axis);
        let high = mark_of(step, 3u + axis);
        if cell[axis] < mark(low) {
            atomicMin(&marks[low], cell[axis]);
        }
        if cell[axis] > mark(high) {
            atomicMax(&marks[high], cell[axis]);
        }
    }
}

// The box of the first substep.
@compute @workgroup_size(WORKGROUP)
fn survey(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p < substep.particles {
        widen(substep.step, vec3<f32>(now[place(0u, p)], now[place(1u, p)], now[place(2u, p)]));
    }
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    let node_grid = node_grid_now();
    if p >= substep.particles || !node_grid.sound || !node_grid.fits {
        return;
    }
    let x = vec3<f32>(now[place(0u, p)], now[place(1u, p)], now[place(2u, p)]);
    var s = stencil_of(node_grid, x);
    var v = vec3<f32>(0.0);
    // columns of Σ w v δᵀ
    var moment = array<vec3<f32>, 3>();
    for (var a = 0; a < 3; a++) {
        for (var b = 0; b < 3; b++) {
            let row = node_number(node_grid, s.cell + vec3<i32>(a, b, 0));
            for (var c = 0; c < 3; c++) {
                let weighted = s.w[a].x * s.w[b].y * s.w[c].z * grid[row + u32(c)].xyz;
                v += weighted;
                moment[0] += weighted * s.delta[a].x;
                moment[1] += weighted * s.delta[b].y;
                moment[2] += weighted * s.delta[c].z;
            }
        }
    }
    let four = 4.0 * substep.inverse_dx * substep.inverse_dx;
    let moved = x + substep.dt * v;
    var sound = true;
    for (var axis = 0u; axis < 3u; axis++) {
        next[place(axis, p)] = moved[axis];
        next[place(V + axis, p)] = v[axis];
        for (var column = 0u; column < 3u; column++) {
            next[place(C + 3u * axis + column, p)] = four * moment[column][axis];
        }
        sound = sound && is_finite(v[axis]) && abs(v[axis]) <= substep.speed
            && moved[axis] >= substep.low[axis] && moved[axis] <= substep.high[axis];
    }
    if sound {
        widen(substep.step + 1u, moved);
    } else {
        atomicMin(&marks[mark_of(substep.step, BROKEN)], p);
        atomicMin(&marks[0], substep.step);
    }
}
