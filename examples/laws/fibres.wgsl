// Transversely isotropic fibres in a neo-Hookean matrix: the fibres resist extension only.

struct Parameters {
    /// Young's modulus of the matrix E [Pa], log10, 1e3 to 1e6
    young: f32,
    /// Poisson's ratio of the matrix ν [-], between -0.45 and 0.45, 0 to 0.45, usually 0.30 +- 0.11
    poisson: f32,
    /// Modulus of the fibres k [Pa], log10, 1e3 to 1e6
    fibres: f32,
}

// The direction of the fibres at rest.
const DIRECTION = vec3<f32>(0.96, 0.28, 0.0);

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let m = lame(p.young, p.poisson);
    let f = point.f;
    var tau = m.x * (f * transpose(f) - identity()) + m.y * log(det(f)) * identity();
    let a = f * DIRECTION;
    let extension = dot(a, a) - 1.0;
    if extension > 0.0 {
        tau += p.fibres * extension * outer(a, a);
    }
    return tau;
}
