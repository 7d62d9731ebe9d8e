//! The same bits whatever the number of threads and whatever is kept in memory.

use gradreel_models::physics::Remat;

use crate::scene_tape::Drop;

fn bits((loss, motion, gradients): (f64, Vec<f64>, Vec<Vec<f64>>)) -> Vec<u64> {
    [vec![loss], motion, gradients.concat()].concat().into_iter().map(f64::to_bits).collect()
}

#[test]
fn threads_do_not_matter() {
    for single in [false, true] {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bits(Drop::new(13).run(Remat::Every(10), single).unwrap()))
        };
        let one = with(1);
        assert!(one == with(2), "two threads");
        assert!(one == with(3), "three threads");
    }
}

#[test]
fn what_is_kept_does_not_matter() {
    let with = |remat: Remat| bits(Drop::new(7).run(remat, true).unwrap());
    let all = with(Remat::None);
    let state = 2 * 24 * 256 * size_of::<f32>();
    for remat in [
        Remat::Every(1),
        Remat::Every(2),
        Remat::Every(7),
        Remat::Every(24),
        Remat::Every(1000),
        Remat::Auto { bytes: 0 },
        Remat::Auto { bytes: 30 * state },
        Remat::default(),
    ] {
        assert!(all == with(remat), "{remat:?}");
    }
}
