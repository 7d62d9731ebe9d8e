// Water, honey: resistance to compression, and viscous shear stress. Only the volume ratio is kept.

struct Parameters {
    /// Viscosity μ [Pa s], log10, 1e-1 to 1e3
    viscosity: f32,
    /// Bulk modulus κ [Pa], log10, 1e3 to 1e7, compression 7
    bulk: f32,
}

fn return_map(point: Point, p: Parameters) -> mat3x3<f32> {
    let volume = (1.0 + point.dt * trace(point.c)) * det(point.previous);
    return diagonal(vec3(max(volume, 0.05), 1.0, 1.0));
}

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let j = det(point.f);
    return identity() * (p.bulk * (j - pow(j, -6.0))) + sym(point.c) * (p.viscosity * j);
}

fn wave_speed(p: Parameters, density: f32) -> f32 {
    return sqrt(7.0 * p.bulk / density);
}
