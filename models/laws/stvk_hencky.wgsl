// Metal within its elastic range: stress linear in the Hencky strain.

struct Parameters {
    /// Young's modulus E [Pa], log10, 1e3 to 1e7
    young: f32,
    /// Poisson's ratio ν [-], between -0.45 and 0.45, 0 to 0.45, usually 0.30 +- 0.11
    poisson: f32,
}

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let m = lame(p.young, p.poisson);
    let strain = log(max(stretches(point.f), vec3(0.05)));
    return left(point.f, 2.0 * m.x * strain + m.y * (strain.x + strain.y + strain.z));
}

// P-wave speed
fn wave_speed(p: Parameters, density: f32) -> f32 {
    let m = lame(p.young, p.poisson);
    return sqrt((m.y + 2.0 * m.x) / density);
}
