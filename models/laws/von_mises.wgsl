// Plasticine: elastic in Hencky strain up to the yield stress of a tensile test, perfectly plastic beyond.

struct Parameters {
    /// Young's modulus E [Pa], log10, 1e3 to 1e7, usually 200 times yield_stress +- 0.7
    young: f32,
    /// Poisson's ratio ν [-], between -0.45 and 0.45, 0 to 0.45, usually 0.30 +- 0.11
    poisson: f32,
    /// Yield stress τ_Y [Pa], log10, 1e2 to 1e6
    yield_stress: f32,
}

fn return_map(point: Point, p: Parameters) -> mat3x3<f32> {
    let mu = lame(p.young, p.poisson).x;
    let strain = log(max(stretches(point.f), vec3(0.05)));
    let mean = (strain.x + strain.y + strain.z) / 3.0;
    let shear = strain - mean;
    let s = 2.0 * mu * shear;
    let length = sqrt(dot(s, s) + 1e-8);
    let beyond = length - p.yield_stress * sqrt(2.0 / 3.0);
    var kept = 1.0;
    if beyond > 0.0 {
        kept = 1.0 - beyond / length;
    }
    return two_point(point.f, exp(shear * kept + mean));
}

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let m = lame(p.young, p.poisson);
    let strain = log(stretches(point.f));
    return left(point.f, 2.0 * m.x * strain + m.y * (strain.x + strain.y + strain.z));
}

fn wave_speed(p: Parameters, density: f32) -> f32 {
    let m = lame(p.young, p.poisson);
    return sqrt((m.y + 2.0 * m.x) / density);
}
