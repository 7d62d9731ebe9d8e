use gradreel::DType;
use gradreel::optim::Adam;
use gradreel_models::field::*;
use gradreel_models::identify::*;
use gradreel_models::particles::Particles;
use gradreel_models::physics::*;
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
    compare(&Particles::of_field(&field, &params, 0.2).unwrap());
    let rays = Arc::new(Rays::of_cameras(&clip.cameras));
    let target = Target::of(&clip, 0, &Weights::default(), DType::F32).unwrap();
    let settings = FitSettings::default();
    let t = Instant::now();
    let adam = Adam::new(0.1)
        .with_rate("field.density", settings.density_rate)
        .with_rate("field.colour", settings.colour_rate);
    let splat = Splat { spacing: dx, particle_spacing: dx / 2.0 };

    let config = Config::default();
    let observed = Observed::of(&clip, &config, DType::F32).unwrap();
    let v = [-0.4037, -0.5965, 0.0992];
    let c = field.centres();
    let pose = |f: usize| {
        let t = f as f64 / 24.0;
        Pose {
            positions: gradreel::Tensor::from_vec(
                (0..c.nrows())
                    .flat_map(|i| {
                        [0, 1, 2].map(|a| (c[[i, a]] + v[a] * t - if a == 1 { 4.9 * t * t } else { 0.0 }) as f32)
                    })
                    .collect(),
                [c.nrows(), 3],
            ),
            target: &observed.targets[f],
        }
    };
    let rays2 = &observed.rays;
    let one = [pose(0)];
    let params = fit(&field, params, adam.clone(), 0..80, &one, rays2, &Surface::default(), &splat, |s| {
        if s.iteration % 40 == 0 {
            println!("{} {:.5} {:?}", s.iteration, s.loss, t.elapsed());
            compare(&Particles::of_field(&field, s.params, 0.2).unwrap());
        }
        Ok(())
    })
    .unwrap();
    let many: Vec<_> = (0..5).map(pose).collect();
    let params = fit(&field, params, adam, 0..80, &many, rays2, &Surface::default(), &splat, |s| {
        if s.iteration % 20 == 0 {
            println!("{} {:.5} {:?}", s.iteration, s.loss, t.elapsed());
            compare(&Particles::of_field(&field, s.params, 0.2).unwrap());
        }
        Ok(())
    })
    .unwrap();
    let p = Particles::of_field(&field, &params, 0.2).unwrap();
    compare(&p);
    compare(&Particles::of_field(&field, &params, 0.5).unwrap());
    let mut hist = [0; 10];
    for a in &p.opacity {
        hist[(a * 9.999) as usize] += 1;
    }
    println!("{hist:?}");

    let law = materials::find("neo_hookean").unwrap();
    let u = Unknowns { velocity: [0.0; 3], parameters: vec![1e4, 0.1] };
    let coarse = p.coarsened();
    let run = |name: &str, particles: &Particles, u: &Unknowns, free, frames, iterations| {
        let problem = Problem::new(particles, &observed, law.clone(), &config, DType::F32);
        println!("== {name}: {} particles, {:?}", particles.len(), problem.schedule(u, frames));
        let t = Instant::now();
        let mut k = 0;
        let best = estimate(
            &problem,
            u,
            free,
            frames,
            iterations,
            &mut |e| {
                k += 1;
                println!(
                    "{k} {:.1?} loss {:.6} v {:.4?} E {:.4e} nu {:.4}",
                    t.elapsed(),
                    e.loss,
                    e.unknowns.velocity,
                    e.unknowns.parameters[0],
                    e.unknowns.parameters[1]
                );
                Ok(())
            },
            &mut |n| println!("note {n}"),
        )
        .unwrap();
        println!("best {best:?}");
        (best.unknowns, problem.world)
    };

    let mode = std::env::args().nth(3).unwrap();
    let u = Unknowns { velocity: [-0.4, -0.6, 0.1], parameters: vec![2.5e5, 0.2] };
    let mut q = p.clone();
    if mode == "true" {
        q.positions = rest.chunks(3).map(|y| [y[0], y[1], y[2]]).collect();
        q.opacity = vec![1.0; q.positions.len()];
        q.colour = q
            .positions
            .iter()
            .map(|y| {
                let i = (0..p.len())
                    .min_by(|&i, &j| {
                        let d = |i: usize| (0..3).map(|a| (p.positions[i][a] - y[a]).powi(2)).sum::<f64>();
                        d(i).total_cmp(&d(j))
                    })
                    .unwrap();
                p.colour[i]
            })
            .collect();
    }
    if mode == "hard" {
        let keep: Vec<usize> = (0..p.len()).filter(|&i| p.opacity[i] > 0.5).collect();
        q.positions = keep.iter().map(|&i| p.positions[i]).collect();
        q.colour = keep.iter().map(|&i| p.colour[i]).collect();
        q.opacity = vec![1.0; keep.len()];
    }
    let problem = Problem::new(&q, &observed, law.clone(), &config, DType::F32);
    // per-frame loss at the truth
    let truth_u = Unknowns { velocity: [-0.4, -0.6, 0.1], parameters: vec![3e5, 0.3] };
    {
        let tape = gradreel::Tape::new();
        let bound = truth_u.bind(&tape, &law, Free::Material, DType::F32).unwrap();
        let motion = problem.motion(&tape, &bound, problem.schedule(&truth_u, 14)).unwrap();
        let x = motion.value().unwrap().to_vec().unwrap();
        let n = q.len();
        let tx = truth.get("x").unwrap().to_vec().unwrap();
        let m = rest.len() / 3;
        for f in 0..14 {
            let l = problem.loss(&motion.slice(0, f..f + 1), 1).unwrap();
            let _ = l;
            let op = tape.constant(q.opacity(DType::F32).unwrap());
            let co = tape.constant(q.colour(DType::F32).unwrap());
            let px = problem.render(&motion.select(0, f), &op, &co).unwrap();
            let loss = observed.targets[f].loss(&px).item().unwrap();
            let w: f64 = q.opacity.iter().sum();
            let com: Vec<f64> =
                (0..3).map(|a| (0..n).map(|i| q.opacity[i] * x[(f * n + i) * 3 + a]).sum::<f64>() / w).collect();
            let tcom: Vec<f64> =
                (0..3).map(|a| (0..m).map(|i| tx[(f * m + i) * 3 + a]).sum::<f64>() / m as f64).collect();
            println!("frame {f} loss {loss:.5} com {com:.4?} true {tcom:.4?}");
        }
    }
    let (u, _) = run("fine", &q, &u, Free::Material, 14, 8);
    println!("log10 E error {:.4} nu error {:.4}", u.parameters[0].log10() - 3e5f64.log10(), u.parameters[1] - 0.3);
}
