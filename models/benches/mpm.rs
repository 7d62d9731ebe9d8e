//! Nanoseconds per particle and substep of the material point method, forwards and backwards.
//!
//! `cargo bench -p gradreel-models --bench mpm [-- threads [particles [material]]]`. A ball rests on a sticky floor: grid
//! spacing 2 cm, 8 particles per cell. The floor is what the machine needs to move the particles' state through memory:
//! read and written once forwards, read twice and its cotangent read and written backwards, at the bandwidth of a copy measured
//! in the same run. Both are wall times; with one thread, `cpu` is the processor time of the process.

mod bodies;

use std::hint::black_box;
use std::time::Instant;

use bodies::ball;
use gradreel_models::physics::{Collider, Number, Simulation, State, Values, World, materials, neighbours};

/// Bytes of a particle's state, in numbers: position, velocity, affine velocity, deformation.
const STATE: f64 = 24.0;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let number = |at: usize| arguments.get(at).and_then(|argument| argument.parse::<usize>().ok());
    let threads = number(0).unwrap_or(1);
    let counts = number(1).map_or(vec![20_000, 100_000, 1_000_000], |count| vec![count]);
    let filter = arguments.get(2).map_or("", String::as_str);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    pool.install(|| {
        let bandwidth = copy_bandwidth(threads);
        println!("{}; copy {:.1} GB/s on {threads} threads", gradreel::isa(), bandwidth * 1e-9);
        for count in counts {
            for (name, parameters) in [
                ("neo_hookean", vec![1e5, 0.3]),
                ("von_mises", vec![1e5, 0.3, 2e3]),
                ("drucker_prager", vec![1e5, 0.3, 35.0, 0.0]),
            ] {
                if name.contains(filter) {
                    measure::<f32>(name, &parameters, count, bandwidth);
                }
            }
        }
        if filter.is_empty() {
            measure::<f64>("neo_hookean", &[1e5, 0.3], 20_000, bandwidth);
        }
    });
}

fn measure<T: Number>(name: &str, parameters: &[f64], count: usize, bandwidth: f64) {
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.02) };
    let law = materials::find(name).expect("a shipped material");
    let positions = ball(count, world.dx);
    let order = neighbours(world.dx, &positions, |_| 0);
    let positions: Vec<[T; 3]> = order.iter().map(|&p| positions[p as usize].map(T::from_f64)).collect();
    let fall = [T::ZERO, T::from_f64(-1.0), T::ZERO];
    let parameters = parameters.iter().map(|&value| Values::Same(T::from_f64(value))).collect();
    let density = Values::Same(T::from_f64(1000.0));
    let mut simulation = Simulation::new(&world, &law, 2e-4, count, &density, parameters).expect("sound inputs");
    let mut now = State::at_rest(&positions, &vec![fall; count]).expect("finite numbers");
    let mut next = State::zeros(count);
    let steps = (2_000_000 / count).clamp(4, 40);
    let mut step = |simulation: &mut Simulation<'_, T>| {
        simulation.substep(&now, &mut next).expect("a stable step");
        std::mem::swap(&mut now, &mut next);
    };
    (0..2 * steps).for_each(|_| step(&mut simulation));
    let forward = least(4, steps * count, || (0..steps).for_each(|_| step(&mut simulation)));
    let mut cotangent = now.clone();
    let reverse = least(4, steps * count, || {
        for _ in 0..steps {
            simulation.substep_vjp(&now, &mut next, &mut cotangent).expect("a stable step");
        }
    });
    let bytes = STATE * size_of::<T>() as f64;
    let line = |[wall, cpu]: [f64; 2], moved: f64| {
        format!(
            "{:6.1} ns (cpu {:6.1}, {:3.0} B, {:4.1} x copy)",
            wall * 1e9,
            cpu * 1e9,
            moved,
            wall * bandwidth / (moved)
        )
    };
    println!(
        "{} {:<15} {count:>8} particles   forward {}   reverse {}",
        T::NAME,
        law.name(),
        line(forward, 2.0 * bytes),
        line(reverse, 4.0 * bytes),
    );
}

/// The least wall and processor time \[s\] of several runs, per piece of work.
fn least(runs: usize, pieces: usize, mut run: impl FnMut()) -> [f64; 2] {
    let mut least = [f64::INFINITY; 2];
    for _ in 0..runs {
        let (wall, cpu) = (Instant::now(), processor_time());
        run();
        let spent = [wall.elapsed().as_secs_f64(), processor_time() - cpu];
        (0..2).for_each(|k| least[k] = least[k].min(spent[k] / pieces as f64));
    }
    least
}

/// Processor time of this process \[s\], where the system tells it to a hundredth of a second; NaN elsewhere.
fn processor_time() -> f64 {
    let Ok(status) = std::fs::read_to_string("/proc/self/stat") else { return f64::NAN };
    let fields: Vec<f64> = status
        .rsplit(')')
        .next()
        .map_or(Vec::new(), |rest| rest.split_whitespace().map(|field| field.parse().unwrap_or(f64::NAN)).collect());
    // fields 14 and 15 of the whole line: ticks in user and in kernel mode
    fields.get(11).zip(fields.get(12)).map_or(f64::NAN, |(user, kernel)| (user + kernel) / 100.0)
}

/// Bytes read and written per second by a copy of 256 MiB.
fn copy_bandwidth(threads: usize) -> f64 {
    let from = vec![1.0f32; 64 << 20];
    let mut to = vec![0.0f32; 64 << 20];
    let part = from.len().div_ceil(threads);
    let [wall, _] = least(5, 8 * from.len(), || {
        rayon::scope(|scope| {
            for (to, from) in to.chunks_mut(part).zip(from.chunks(part)) {
                scope.spawn(move |_| to.copy_from_slice(from));
            }
        });
        black_box(&mut to);
    });
    1.0 / wall
}
