// Toothpaste: beyond the yield stress the stress relaxes over time.

struct Parameters {
    /// Shear modulus μ [Pa], log10, 1e2 to 1e6, usually 10 times yield_stress +- 0.5
    shear: f32,
    /// Bulk modulus κ [Pa], log10, 1e3 to 1e7, compression 1
    bulk: f32,
    /// Yield stress τ_Y [Pa], log10, 1e1 to 1e5
    yield_stress: f32,
    /// Plastic viscosity η [Pa s], log10, 1e-1 to 1e3
    plastic_viscosity: f32,
}

fn return_map(point: Point, p: Parameters) -> mat3x3<f32> {
    let stretch = max(stretches(point.f), vec3(0.05));
    let strain = log(stretch);
    let mean = (strain.x + strain.y + strain.z) / 3.0;
    let shear = strain - mean;
    let s = 2.0 * p.shear * shear;
    let length = sqrt(dot(s, s) + 1e-8);
    let beyond = length - p.yield_stress * sqrt(2.0 / 3.0);
    let stiff = p.shear * dot(stretch, stretch) / 3.0;
    let slowness = p.plastic_viscosity / (2.0 * stiff * point.dt);
    let kept = select(1.0, 1.0 - beyond / ((1.0 + slowness) * length), beyond > 0.0);
    return two_point(point.f, exp(shear * kept + mean));
}

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let strain = log(stretches(point.f));
    let lambda = p.bulk - 2.0 * p.shear / 3.0;
    return left(point.f, 2.0 * p.shear * strain + lambda * (strain.x + strain.y + strain.z));
}

fn wave_speed(p: Parameters, density: f32) -> f32 {
    return sqrt((p.bulk + 4.0 * p.shear / 3.0) / density);
}
