//! From a scene file to the simulator's input; every error names the offending key.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use super::file::{Barrier, Ground, Obstacle, Precision, SceneFile, Substance, Touch};
use super::fill::body;
use crate::nearest::{listed, nearest};
use crate::physics::{Collider, Contact, Law, Map, NodeGrid, Region, Schedule, Values, World, is_thin, materials};
use crate::vector::{bounds, cross, minus, norm, plus, rotation, times, unit};

/// Maximum mass of a particle \[kg\]; larger sums overflow `f32`.
const HEAVIEST: f64 = 1e20;
/// Rounding of positions, in cells, above which a note is given.
const ROUNDING: f64 = 1e-3;

/// Default colours of objects.
const COLOURS: [[u8; 3]; 6] =
    [[214, 96, 62], [66, 133, 201], [70, 160, 108], [226, 173, 62], [150, 104, 184], [120, 130, 140]];

/// A material for the simulator.
#[derive(Debug, Clone)]
pub struct Stuff {
    /// Its name in the file.
    pub name: String,
    /// Its law.
    pub law: Law,
    /// Its parameters, in the law's order.
    pub parameters: Vec<f64>,
    /// Density \[kg/m³\].
    pub density: f64,
}

/// All particles in the order of the objects, and their surroundings.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Surroundings.
    pub world: World,
    /// Materials.
    pub materials: Vec<Stuff>,
    /// Positions \[m\].
    pub positions: Vec<[f64; 3]>,
    /// Velocities \[m/s\].
    pub velocities: Vec<[f64; 3]>,
    /// Angular velocity \[rad/s\] of each particle's object.
    pub spins: Vec<[f64; 3]>,
    /// Index of each particle's material.
    pub material_of: Vec<u32>,
    /// Index of each particle's object.
    pub object_of: Vec<u32>,
    /// Rest volume of each particle of an object \[m³\].
    pub volumes: Vec<f64>,
    /// Notes on shapes that the grid does not resolve, one line each.
    pub notes: Vec<String>,
    /// Colour of each object.
    pub colours: Vec<[u8; 3]>,
    /// Frames and substeps.
    pub schedule: Schedule,
    /// Whether the substeps were derived and may be halved.
    pub automatic: bool,
    /// Maximum speed of sound and expected maximum particle speed \[m/s\].
    pub speeds: [f64; 2],
    /// Floating-point type.
    pub precision: Precision,
}

impl Setup {
    /// Height of the first horizontal floor \[m\].
    pub fn floor(&self) -> Option<f64> {
        self.world.colliders.iter().find_map(|collider| match collider.region {
            Region::Plane { point, normal } if normal[1] > 0.999 => Some(point[1]),
            _ => None,
        })
    }

    /// Fills the shapes and validates the scene; files are relative to `folder`.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the offending key, or for substeps that are too long or too many.
    pub fn of(file: &SceneFile, folder: &Path) -> Result<Self> {
        check_numbers(file)?;
        check_ranges(file)?;
        let per_edge = (file.grid.particles_per_cell as f64).cbrt().round();
        let spacing = file.grid.spacing_m / per_edge;
        let names: Vec<&str> = file.materials.keys().map(String::as_str).collect();
        let materials =
            file.materials.iter().map(|(name, given)| stuff(name, given, folder)).collect::<Result<Vec<_>>>()?;
        let colliders = obstacles(file)?;
        let world = World {
            gravity: file.world.gravity_m_s2,
            colliders: colliders.iter().map(|(_, collider)| *collider).collect(),
            flip: file.grid.flip,
            particle_volume: spacing.powi(3),
            bounds: file.world.bounds_m,
            node_limit: file.grid.node_limit,
            ..World::new(file.grid.spacing_m)
        };
        world.check()?;
        if file.objects.is_empty() {
            return Err(Error::new(ErrorKind::Input, "the scene is empty")
                .found("no objects")
                .fix("add an object: [[objects]] with a material and a shape; see examples/scenes"));
        }
        let mut setup = Self {
            world,
            materials,
            positions: Vec::new(),
            velocities: Vec::new(),
            spins: Vec::new(),
            material_of: Vec::new(),
            object_of: Vec::new(),
            volumes: Vec::new(),
            notes: Vec::new(),
            colours: Vec::new(),
            schedule: Schedule { frames: 1, frame_dt: 1.0, substeps: 1 },
            automatic: file.time.substeps_per_frame.is_none(),
            speeds: [0.0; 2],
            precision: file.grid.precision,
        };
        let mut places = Vec::new();
        for (index, object) in file.objects.iter().enumerate() {
            let place = format!("objects[{index}]");
            let Some(material) = names.iter().position(|name| *name == object.material) else {
                return Err(unknown("there is no material of this name", &object.material, &names, "[materials.…]")
                    .at(format!("{place}.material")));
            };
            let seed = file.grid.seed.wrapping_add(index as u64);
            let body = body(&object.shape, spacing, seed, folder).map_err(|e| e.within(format!("{place}.shape")))?;
            let mut particles = body.positions;
            setup.check_volume(body.volume, material).map_err(|e| e.within(&place))?;
            setup.volumes.push(body.volume);
            if body.finer > 1 {
                setup.notes.push(format!(
                    "{place} is small or thin for this grid: its particles are {} times as dense as usual, and it touches \
                     others as if it were about a cell ({:?} m) thick",
                    body.finer.pow(3), file.grid.spacing_m
                ));
            }
            turn(&mut particles, object.turn_deg);
            setup.check_places(&particles, &colliders).map_err(|e| e.within(&place))?;
            let centre = mean(&particles);
            let colour = object.colour.as_deref().map_or(Ok(COLOURS[index % COLOURS.len()]), colour);
            setup.colours.push(colour.map_err(|e| e.within(format!("{place}.colour")))?);
            for x in particles {
                let r = minus(x, centre);
                places.push(r);
                let turning = cross(object.spin_rad_s, r);
                setup.velocities.push(std::array::from_fn(|axis| object.velocity_m_s[axis] + turning[axis]));
                setup.positions.push(x);
                setup.spins.push(object.spin_rad_s);
                setup.material_of.push(material as u32);
                setup.object_of.push(index as u32);
            }
        }
        setup.materials.iter_mut().for_each(|stuff| stuff.law = stuff.law.placed(&places));
        setup.check_box()?;
        setup.note_rounding();
        setup.note_thin_obstacles(&colliders);
        setup.plan(file)?;
        Ok(setup)
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are no particles.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Memory estimate \[bytes\]: particles during the run, and the grid's box at the start.
    pub fn memory(&self) -> [usize; 2] {
        let width = if self.precision == Precision::F64 { 8 } else { 4 };
        let history = self.materials.iter().map(|stuff| stuff.law.history().len()).max().unwrap_or(0);
        let flip = if self.world.flip > 0.0 { 16 } else { 0 };
        // three states (one for rollback), scatter buffers, and index lists
        let particle = width * (3 * (24 + history) + 16 + flip) + 12;
        let [low, high] = bounds(self.positions.iter().copied());
        let nodes: f64 = (0..3).map(|axis| ((high[axis] - low[axis]) / self.world.dx).ceil() + 4.0).product();
        let grid = nodes * (4 * width * if self.world.flip > 0.0 { 2 } else { 1 }) as f64;
        [self.len() * particle, grid as usize]
    }

    /// Frames and substeps.
    fn plan(&mut self, file: &SceneFile) -> Result<()> {
        let time = &file.time;
        let frames = 1 + (time.duration_s * time.frames_per_s).round().max(1.0) as usize;
        let used = |index: usize| self.material_of.contains(&(index as u32));
        let sound = self
            .materials
            .iter()
            .enumerate()
            .filter(|(index, _)| used(*index))
            .map(|(_, stuff)| stuff.law.wave_speed_on(&stuff.parameters, stuff.density, self.world.dx))
            .fold(0.0, f64::max);
        let start = self.velocities.iter().copied().map(norm).fold(0.0, f64::max);
        let [low, high] = bounds(self.positions.iter().copied());
        let floor = file.ground.as_ref().map_or(low[1], |ground| ground.height_m.min(low[1]));
        // not further than within the simulated time
        let g = norm(self.world.gravity);
        let fallen = (2.0 * g * (high[1] - floor)).sqrt().min(g * time.duration_s);
        let pushed = self.world.colliders.iter().map(|c| norm(c.motion.velocity)).fold(0.0, f64::max);
        let speed = (start.powi(2) + fallen.powi(2)).sqrt().max(pushed);
        self.speeds = [sound, speed];
        let frame_dt = 1.0 / time.frames_per_s;
        self.schedule = match time.substeps_per_frame {
            Some(substeps) => Schedule { frames, frame_dt, substeps },
            None => {
                Schedule::check_speeds(&self.world, frame_dt, self.speeds, time.cfl)?;
                Schedule::stable(&self.world, frames, frame_dt, sound, speed, time.cfl)
            }
        };
        self.schedule.check()?;
        for (index, stuff) in self.materials.iter().enumerate().filter(|(index, _)| used(*index)) {
            let parameters: Vec<Values<f64>> = stuff.parameters.iter().map(|&value| Values::Same(value)).collect();
            let first = self.material_of.iter().position(|&m| m as usize == index).unwrap_or(0);
            self.schedule
                .check_waves(&self.world, &stuff.law, &Values::Same(stuff.density), &parameters, first + 1, |p| {
                    p == first
                })
                .map_err(|e| e.within(format!("materials.{}", stuff.name)).with_kind(ErrorKind::Input))?;
        }
        Ok(())
    }

    /// Rejects particles whose mass is too small relative to the empty-node threshold, or too large.
    fn check_volume(&self, volume: f64, material: usize) -> Result<()> {
        let (mass, least) = (volume * self.materials[material].density, 1e5 * self.world.least_mass());
        if mass >= least && mass <= HEAVIEST {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "the particles of the object have a mass that this grid cannot carry")
            .found(format!("{mass:.3e} kg: {volume:.3e} m³ of {:?} kg/m³", self.materials[material].density))
            .wanted(format!("{least:.3e} to {HEAVIEST:.0e} kg"))
            .fix("correct the object's size or its density, or make grid.spacing_m smaller"))
    }

    /// Rejects a box around the particles that exceeds the node limit.
    fn check_box(&self) -> Result<()> {
        let corners = bounds(self.positions.iter().copied());
        let (dx, limit) = (self.world.dx, self.world.node_limit);
        let covered = match self.precision {
            Precision::F32 => NodeGrid::<f32>::covering(corners.map(|x| x.map(|x| x as f32)), dx, limit).map(|_| ()),
            Precision::F64 => NodeGrid::<f64>::covering(corners, dx, limit).map(|_| ()),
        };
        covered.map_err(|e| {
            e.with_kind(ErrorKind::Input).fix(
                "put the objects nearer to each other and to the origin, make grid.spacing_m larger, or raise \
                 grid.node_limit",
            )
        })
    }

    /// Notes where `f32` rounds positions coarsely.
    fn note_rounding(&mut self) {
        let far = self.positions.as_flattened().iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        if self.precision == Precision::F32 && far * f64::from(f32::EPSILON) > ROUNDING * self.world.dx {
            self.notes.push(format!(
                "particles are {far:.4e} m from the origin, where f32 rounds places to {:.1e} m: put them nearer, or compute \
                 with precision f64",
                far * f64::from(f32::EPSILON)
            ));
        }
    }

    fn note_thin_obstacles(&mut self, colliders: &[(String, Collider)]) {
        for (name, collider) in colliders.iter().filter(|(_, collider)| is_thin(collider, self.world.dx)) {
            self.notes.push(format!(
                "{name} is {:.4} m thick, less than two cells ({:?} m): no particle enters it, but bodies feel it up to a cell \
                 before its surface, and those on both sides of it may feel each other",
                collider.thickness(),
                2.0 * self.world.dx
            ));
        }
    }

    /// Rejects particles that start out of bounds or inside an obstacle.
    fn check_places(&self, particles: &[[f64; 3]], colliders: &[(String, Collider)]) -> Result<()> {
        if let Some([low, high]) = self.world.bounds {
            let outside = |x: &&[f64; 3]| (0..3).any(|axis| x[axis] < low[axis] || x[axis] > high[axis]);
            if let Some(x) = particles.iter().find(outside) {
                let count = particles.iter().filter(outside).count();
                return Err(Error::new(ErrorKind::Input, "the object starts outside the world's bounds")
                    .found(format!("{count} of {} particles, one at {x:.4?} m", particles.len()))
                    .wanted(format!("between {low:?} and {high:?} m"))
                    .fix("move the object, or widen world.bounds_m"));
            }
        }
        for (name, collider) in colliders {
            let inside = |x: &&[f64; 3]| collider.normal(**x).is_some();
            if let Some(x) = particles.iter().find(inside) {
                let count = particles.iter().filter(inside).count();
                return Err(Error::new(ErrorKind::Input, "the object starts inside an obstacle")
                    .found(format!("{count} of {} particles in {name}, one at {x:.4?} m", particles.len()))
                    .wanted("objects that start free")
                    .fix("move the object or the obstacle; an obstacle that holds objects needs `container = true`"));
            }
        }
        Ok(())
    }
}

/// An error about an unknown name, with the valid names and the closest match.
fn unknown(what: &str, found: &str, known: &[&str], whence: &str) -> Error {
    let error = Error::new(ErrorKind::Input, what).found(format!("`{found}`"));
    let error = error.wanted(if known.is_empty() {
        format!("one defined under {whence}")
    } else {
        format!("one of {}", listed(known.iter().copied()))
    });
    match nearest(found, known.iter().copied()) {
        Some(near) => error.fix(format!("did you mean `{near}`?")),
        None => error.fix(format!("choose one of these, or define it under {whence}")),
    }
}

fn stuff(name: &str, given: &Substance, folder: &Path) -> Result<Stuff> {
    let place = format!("materials.{name}");
    let laws: Vec<Law> = materials::all().into_iter().filter(|law| !law.name().starts_with("learned")).collect();
    let names: Vec<&str> = laws.iter().map(Law::name).collect();
    let own = match given.law.ends_with(".wgsl") {
        true => Some(Law::read(folder.join(&given.law))?),
        false => materials::find(&given.law),
    };
    let Some(law) = own.as_ref().or_else(|| laws.iter().find(|law| law.name() == given.law)) else {
        return Err(unknown("there is no law of this name", &given.law, &names, "the shipped laws").at(place + ".law"));
    };
    if given.density_kg_m3 <= 0.0 {
        return Err(Error::new(ErrorKind::Input, "the density must be positive")
            .at(place + ".density_kg_m3")
            .found(format!("{} kg/m³", given.density_kg_m3)));
    }
    let known: Vec<&str> = law.parameters().iter().map(|p| p.name).collect();
    if let Some(other) = given.parameters.keys().find(|key| !known.contains(&key.as_str())) {
        let what = format!("the law {} has no parameter of this name", law.name());
        return Err(unknown(&what, other, &known, "the law").at(place));
    }
    let value = |p: &crate::physics::Parameter| {
        let fault = |what: String, found: String, wanted: String| {
            Err(Error::new(ErrorKind::Input, what).at(format!("{place}.{}", p.name)).found(found).wanted(wanted))
        };
        let plausible = format!("{:.3e} to {:.3e} {} are plausible", p.prior[0], p.prior[1], p.unit);
        match given.parameters.get(p.name) {
            None => fault(format!("a parameter of {} is missing", law.name()), "no value".into(), plausible),
            Some(&value) if p.map == Map::Log10 && value < 0.0 => {
                fault("a parameter must not be negative".into(), format!("{value} {}", p.unit), plausible)
            }
            // so far outside the range that it is probably a typing error
            Some(&value) if matches!(p.map, Map::Bounded { low, high } if (value - low).max(high - value) > 2.0 * (high - low)) => {
                fault("a parameter is far outside its range".into(), format!("{value} {}", p.unit), plausible)
            }
            Some(&value) => Ok(value),
        }
    };
    let parameters = law.parameters().iter().map(value).collect::<Result<Vec<f64>>>()?;
    let sound = law.wave_speed(&parameters, given.density_kg_m3);
    if !(sound > 0.0 && sound.is_finite()) {
        return Err(Error::new(ErrorKind::Input, "with these parameters the material has no speed of sound")
            .at(place)
            .found(format!("{:?}", given.parameters))
            .wanted("a positive stiffness, and a Poisson ratio above -1 and below 0.5"));
    }
    Ok(Stuff { name: name.into(), law: law.clone(), parameters, density: given.density_kg_m3 })
}

/// Ground and colliders, with their names for error messages.
fn obstacles(file: &SceneFile) -> Result<Vec<(String, Collider)>> {
    let mut all = Vec::new();
    if let Some(Ground { height_m, contact, friction }) = &file.ground {
        let contact = touch(*contact, *friction).map_err(|e| e.within("ground"))?;
        all.push(("ground".to_owned(), Collider::plane([0.0, *height_m, 0.0], [0.0, 1.0, 0.0], contact)));
    }
    for (index, given) in file.colliders.iter().enumerate() {
        let name = format!("colliders[{index}]");
        let collider = obstacle(given).and_then(|c| c.check().map(|()| c)).map_err(|e| e.within(&name))?;
        all.push((name, collider));
    }
    Ok(all)
}

fn obstacle(given: &Obstacle) -> Result<Collider> {
    let contact = touch(given.contact, given.friction)?;
    let fault = |what: &str| Err(Error::new(ErrorKind::Input, what));
    let (region, centre) = match given.shape {
        Barrier::Plane { point_m, normal } => {
            if !(norm(normal) > 0.0 && norm(normal).is_finite()) {
                return fault("the normal of a plane has no length that can be used");
            }
            (Region::Plane { point: point_m, normal: unit(normal) }, point_m)
        }
        Barrier::Box { centre_m, size_m } => {
            (Region::Cuboid { centre: centre_m, half: size_m.map(|s| s / 2.0) }, centre_m)
        }
        Barrier::Sphere { centre_m, radius_m } => (Region::Sphere { centre: centre_m, radius: radius_m }, centre_m),
        Barrier::Cylinder { start_m, end_m, radius_m } => {
            if start_m == end_m {
                return fault("both ends of a cylinder lie at the same place");
            }
            let centre = std::array::from_fn(|axis| 0.5 * (start_m[axis] + end_m[axis]));
            (Region::Cylinder { start: start_m, end: end_m, radius: radius_m }, centre)
        }
    };
    let pivot = given.pivot_m.unwrap_or(centre);
    let mut collider = Collider::new(region, contact).moving(given.velocity_m_s).spinning(given.spin_rad_s, pivot);
    if given.turn_deg != [0.0; 3] {
        if given.pivot_m.is_some_and(|pivot| pivot != centre) {
            // An initial rotation about its own centre and a spin about another pivot: the rotation moves the
            // region.
            return fault("an obstacle has both turn_deg and a pivot_m that is not its centre");
        }
        collider = collider.turned(given.turn_deg.map(f64::to_radians), pivot);
    }
    collider.container = given.container;
    Ok(collider)
}

fn touch(contact: Touch, friction: Option<f64>) -> Result<Contact> {
    Ok(match (contact, friction) {
        (Touch::Sticky, None) => Contact::Sticky,
        (Touch::Slip, None) => Contact::Slip,
        (Touch::Separate, None) => Contact::Separate,
        (Touch::Friction, Some(mu)) => Contact::Friction(mu),
        (Touch::Friction, None) => {
            return Err(Error::new(ErrorKind::Input, "the contact is friction, but there is no coefficient")
                .fix("add `friction = 0.4`, for example"));
        }
        (_, Some(mu)) => {
            return Err(Error::new(ErrorKind::Input, "a coefficient of friction is given, but the contact is another")
                .found(format!("friction = {mu}"))
                .fix("add `contact = \"friction\"`, or remove the coefficient"));
        }
    })
}

/// Rejects non-finite numbers, naming their key.
fn check_numbers(file: &SceneFile) -> Result<()> {
    fn walk(value: &toml::Value, path: &str) -> Option<(String, f64)> {
        match value {
            toml::Value::Float(x) if !x.is_finite() => Some((path.to_owned(), *x)),
            toml::Value::Array(all) => {
                all.iter().enumerate().find_map(|(k, value)| walk(value, &format!("{path}[{k}]")))
            }
            toml::Value::Table(all) => all.iter().find_map(|(key, value)| {
                walk(value, &if path.is_empty() { key.clone() } else { format!("{path}.{key}") })
            }),
            _ => None,
        }
    }
    let value = toml::Value::try_from(file)
        .map_err(|e| Error::new(ErrorKind::Input, "the scene cannot be looked through").found(e))?;
    match walk(&value, "") {
        None => Ok(()),
        Some((key, found)) => Err(Error::new(ErrorKind::Input, "a number of the scene is not finite")
            .at(key)
            .found(found)
            .wanted("a finite number")),
    }
}

fn check_ranges(file: &SceneFile) -> Result<()> {
    let (time, grid) = (&file.time, &file.grid);
    let frames = time.duration_s * time.frames_per_s;
    let pixels = file.camera.pixels.unwrap_or([1, 1]);
    let rules = [
        (time.duration_s > 0.0, "time.duration_s", "a positive time in seconds"),
        (time.frames_per_s > 0.0 && time.frames_per_s.recip().is_finite(), "time.frames_per_s", "a positive rate"),
        (frames <= 1e5, "time", "at most 100000 frames"),
        (time.substeps_per_frame != Some(0), "time.substeps_per_frame", "at least 1"),
        (time.cfl > 0.0 && time.cfl <= 1.0, "time.cfl", "above 0, at most 1"),
        (grid.spacing_m > 0.0, "grid.spacing_m", "a positive length in metres"),
        ([1, 8, 27, 64].contains(&grid.particles_per_cell), "grid.particles_per_cell", "1, 8, 27 or 64"),
        ((0.0..=1.0).contains(&grid.flip), "grid.flip", "0 (APIC) to 1 (FLIP)"),
        (pixels.iter().all(|&n| (1..=4096).contains(&n)), "camera.pixels", "1 to 4096 each way"),
        (
            file.camera.field_of_view_deg.is_none_or(|a| a > 0.0 && a < 170.0),
            "camera.field_of_view_deg",
            "above 0, below 170 degrees",
        ),
    ];
    match rules.iter().find(|(holds, ..)| !holds) {
        None => Ok(()),
        Some((_, key, wanted)) => {
            Err(Error::new(ErrorKind::Input, "a setting of the scene is outside its range").at(key).wanted(wanted))
        }
    }
}

fn colour(text: &str) -> Result<[u8; 3]> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.is_ascii());
    let byte = |k: usize| digits.and_then(|d| u8::from_str_radix(&d[2 * k..2 * k + 2], 16).ok());
    match [byte(0), byte(1), byte(2)] {
        [Some(r), Some(g), Some(b)] => Ok([r, g, b]),
        _ => Err(Error::new(ErrorKind::Input, "this is no colour").found(format!("`{text}`")).wanted("`#rrggbb`")),
    }
}

/// Rotates particles about their centre.
fn turn(particles: &mut [[f64; 3]], turn_deg: [f64; 3]) {
    if turn_deg == [0.0; 3] {
        return;
    }
    let (centre, turn) = (mean(particles), rotation(turn_deg.map(f64::to_radians)));
    for x in particles {
        *x = plus(centre, times(&turn, minus(*x, centre)));
    }
}

fn mean(particles: &[[f64; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|axis| particles.iter().map(|x| x[axis]).sum::<f64>() / particles.len().max(1) as f64)
}
