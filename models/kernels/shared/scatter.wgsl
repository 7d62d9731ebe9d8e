// Particle to grid without atomics: a node gathers from the particles of the 27 cells whose stencils hold it. Particles are
// sorted by cell, and by their number within a cell, so that the order of a sum is always the same.
//
// A record is what a particle scatters: [q, m | A's first column, x₀ | second column, x₁ | third column, x₂].
@group(0) @binding(4) var<storage, read> starts: array<u32>;
@group(0) @binding(5) var<storage, read> bases: array<u32>;
@group(0) @binding(6) var<storage, read> records: array<vec4<f32>>;

// Twin of the constant of sort.wgsl.
const SPAN: u32 = 4096u;

fn start_of(cell: u32) -> u32 {
    return starts[cell] + bases[cell / SPAN];
}

// The quadratic B-spline at a distance in nodes.
fn weight(distance: vec3<f32>) -> vec3<f32> {
    let d = abs(distance);
    let outer = max(1.5 - d, vec3<f32>(0.0));
    return select(0.5 * outer * outer, 0.75 - d * d, d < vec3<f32>(0.5));
}

// Σ w [q + A δ, m] over the records from number `first` on.
fn scattered(node_grid: NodeGrid, node: vec3<i32>, first: u32) -> vec4<f32> {
    let place = vec3<f32>(node + node_grid.low);
    let low = max(node - 2, vec3<i32>(0));
    let high = min(node, node_grid.shape - 3);
    var total = vec4<f32>(0.0);
    for (var x = low.x; x <= high.x; x++) {
        // most of the box is empty: no particle from the first of these cells to the last
        let first_of_plane = start_of(node_number(node_grid, vec3<i32>(x, low.y, low.z)));
        if first_of_plane == start_of(node_number(node_grid, vec3<i32>(x, high.y, high.z)) + 1u) {
            continue;
        }
        for (var y = low.y; y <= high.y; y++) {
            let begin = start_of(node_number(node_grid, vec3<i32>(x, y, low.z)));
            let end = start_of(node_number(node_grid, vec3<i32>(x, y, high.z)) + 1u);
            for (var slot = first + begin; slot < first + end; slot++) {
                let r = array<vec4<f32>, 4>(
                    records[4u * slot], records[4u * slot + 1u], records[4u * slot + 2u], records[4u * slot + 3u]
                );
                let distance = vec3<f32>(r[1].w, r[2].w, r[3].w) * substep.inverse_dx - place;
                let w = weight(distance);
                let delta = -substep.dx * distance;
                let moved = r[0].xyz + r[1].xyz * delta.x + r[2].xyz * delta.y + r[3].xyz * delta.z;
                total += w.x * w.y * w.z * vec4<f32>(moved, r[0].w);
            }
        }
    }
    return total;
}
