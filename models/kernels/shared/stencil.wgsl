// The 27 nodes around a particle: quadratic B-spline weights and distances. Twin of src/physics/transfer.rs.
struct Stencil {
    // the first node
    cell: vec3<i32>,
    // by node along an axis; components are axes
    w: array<vec3<f32>, 3>,
    // ∂w/∂x [1/m]
    dw: array<vec3<f32>, 3>,
    // node minus particle [m]
    delta: array<vec3<f32>, 3>,
}

fn stencil_of(node_grid: NodeGrid, x: vec3<f32>) -> Stencil {
    var s: Stencil;
    s.cell = cell_of(node_grid, x);
    let f = x * substep.inverse_dx - vec3<f32>(s.cell + node_grid.low);
    let a = 1.5 - f;
    let b = f - 1.0;
    let c = f - 0.5;
    s.w[0] = 0.5 * a * a;
    s.w[1] = 0.75 - b * b;
    s.w[2] = 0.5 * c * c;
    s.dw[0] = -substep.inverse_dx * a;
    s.dw[1] = -2.0 * substep.inverse_dx * b;
    s.dw[2] = substep.inverse_dx * c;
    s.delta[0] = -substep.dx * f;
    s.delta[1] = -substep.dx * b;
    s.delta[2] = substep.dx * (2.0 - f);
    return s;
}
