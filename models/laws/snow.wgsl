// Snow: elastic within narrow limits, plastic beyond, hardening under compaction.

struct Parameters {
    /// Young's modulus E [Pa], log10, 1e4 to 1e6
    young: f32,
    /// Poisson's ratio ν [-], between -0.45 and 0.45, 0 to 0.4
    poisson: f32,
    /// Critical compression θ_c [-], log10, 1e-2 to 1e-1
    critical_compression: f32,
    /// Critical stretch θ_s [-], log10, 2e-3 to 2e-2
    critical_stretch: f32,
    /// Hardening ξ [-], between 0 and 20, 5 to 15
    hardening: f32,
}

struct History {
    /// Plastic volume ratio [-], start 1
    plastic_volume: f32,
}

// The plastic volume ratio below which hardening no longer increases.
const DENSEST = 0.6;

fn product(v: vec3<f32>) -> f32 {
    return v.x * v.y * v.z;
}

fn clamped(f: mat3x3<f32>, p: Parameters) -> vec3<f32> {
    return min(max(stretches(f), vec3(1.0 - p.critical_compression)), vec3(1.0 + p.critical_stretch));
}

fn return_map(point: Point, p: Parameters) -> mat3x3<f32> {
    return two_point(point.f, clamped(point.f, p));
}

fn evolve(point: Point, p: Parameters, h: History) -> History {
    let all = product(max(stretches(point.f), vec3(0.05)));
    return History(max(h.plastic_volume * all / product(clamped(point.f, p)), 0.05));
}

fn stress(point: Point, p: Parameters, h: History) -> mat3x3<f32> {
    let harder = exp(p.hardening * (1.0 - max(h.plastic_volume, DENSEST)));
    let m = lame(p.young * harder, p.poisson);
    let s = stretches(point.f);
    let j = product(s);
    return left(point.f, 2.0 * m.x * (s - 1.0) * s + m.y * (j - 1.0) * j);
}

fn wave_speed(p: Parameters, density: f32) -> f32 {
    let m = lame(p.young * exp(p.hardening * (1.0 - DENSEST)), p.poisson);
    return sqrt((m.y + 2.0 * m.x) / density);
}
