// Particle to grid, and the update of nodes: momentum and mass become velocity and mass, by gravity, then obstacles.
@group(0) @binding(2) var<storage, read_write> grid: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    let node_grid = node_grid_now();
    if i >= substep.capacity || !node_grid.sound || !node_grid.fits {
        return;
    }
    // for the next sort
    counts[i] = 0u;
    let number = i32(i);
    let row = number / node_grid.shape.z;
    let node = vec3<i32>(row / node_grid.shape.y, row % node_grid.shape.y, number % node_grid.shape.z);
    if node.x >= node_grid.shape.x {
        return;
    }
    let sum = scattered(node_grid, node, 0u);
    var v = vec3<f32>(0.0);
    if sum.w > substep.least_mass {
        let x = vec3<f32>(node + node_grid.low) * substep.dx;
        v = walk(x, sum.xyz / sum.w + substep.kick, NONE).v;
    }
    grid[i] = vec4<f32>(v, sum.w);
}
