use gradreel::DType;
use gradreel::optim::Adam;
use gradreel_models::field::*;
use gradreel_models::particles::Particles;
use gradreel_models::render::*;
use gradreel_models::video::*;
use std::sync::Arc;
use std::time::Instant;
fn main() {
    let path = std::env::args().nth(1).unwrap();
    let factor: usize = std::env::args().nth(2).unwrap().parse().unwrap();
    let t = Instant::now();
    let clip = Clip::open(path.as_ref(), &OpenOptions::default()).unwrap();
    println!("open {:?}", t.elapsed());
    let clip = clip.scaled(factor);
    let dx = 0.02;
    let sphere = bounding_sphere(&clip, 0).unwrap();
    println!("{sphere:?}");
    let t = Instant::now();
    let h = hull(&clip, 0, &sphere, dx / 2.0, 0.3).unwrap();
    println!("hull {} {:?}", h.voxels.len(), t.elapsed());
    let (field, params) = Field::filling(h, &clip);
    let truth = gradreel::io::safetensors::TensorFile::read("/work/shared/scenes/bird.safetensors").unwrap();
    let rest = truth.get("rest").unwrap().to_vec().unwrap();
    let compare = |p: &Particles| {
        // voxel occupancy on 1 cm grid
        use std::collections::HashSet;
        let key = |x: &[f64]| -> [i64; 3] { [0, 1, 2].map(|a| (x[a] / 0.01).floor() as i64) };
        // the truth's jittered particles: dilate by nearest distance test
        let a: HashSet<_> = p.positions.iter().map(|x| key(x)).collect();
        let mut near = 0;
        for x in &p.positions {
            let d =
                rest.chunks(3).map(|y| (0..3).map(|a| (x[a] - y[a]).powi(2)).sum::<f64>()).fold(1e9, f64::min).sqrt();
            if d < 0.0095 {
                near += 1;
            }
        }
        let mut cov = 0;
        for y in rest.chunks(3) {
            let d = p
                .positions
                .iter()
                .map(|x| (0..3).map(|a| (x[a] - y[a]).powi(2)).sum::<f64>())
                .fold(1e9, f64::min)
                .sqrt();
            if d < 0.0095 {
                cov += 1;
            }
        }
        let com =
            (0..3).map(|a| rest.chunks(3).map(|y| y[a]).sum::<f64>() / (rest.len() / 3) as f64).collect::<Vec<_>>();
        println!(
            "n {} vol {:.6} (truth 0.009390) precision {:.4} recall {:.4} com {:?} vs {:?} {}",
            p.len(),
            p.volume(),
            near as f64 / p.len() as f64,
            cov as f64 / (rest.len() / 3) as f64,
            p.centre_of_mass(),
            com,
            a.len()
        );
    };
    compare(&Particles::of_field(&field, &params, 0.1).unwrap());
    let rays = Arc::new(Rays::of_cameras(&clip.cameras));
    let target = Target::of(&clip, 0, &Weights::default(), DType::F32).unwrap();
    let settings = FitSettings::default();
    let t = Instant::now();
    let adam = Adam::new(0.1)
        .with_rate("field.density", settings.density_rate)
        .with_rate("field.colour", settings.colour_rate);
    let splat = Splat { spacing: dx, particle_spacing: dx / 2.0 };
    let params = fit(&field, params, adam, 0, &target, &rays, &Surface::default(), &splat, &settings, |s| {
        if s.iteration % 20 == 1 {
            println!("{} {:.5} {:?}", s.iteration, s.loss, t.elapsed());
            compare(&Particles::of_field(&field, s.params, 0.1).unwrap());
        }
        Ok(())
    })
    .unwrap();
    let p = Particles::of_field(&field, &params, 0.1).unwrap();
    compare(&p);
    compare(&Particles::of_field(&field, &params, 0.5).unwrap());
    let mut hist = [0; 10];
    for a in &p.opacity {
        hist[(a * 9.999) as usize] += 1;
    }
    println!("{hist:?}");
}
