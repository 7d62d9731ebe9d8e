//! The instruction set of a run: decided here, once, for all kernels of the process.

use std::fmt;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

use crate::{Error, ErrorKind, Result};

/// The instruction sets that CPU kernels are compiled for on this kind of processor, widest last. Which one runs is
/// decided when the program runs; nothing has to be set at compile time.
///
/// The environment variable [`Path::VARIABLE`] names another one than the widest: to compare machines, or to check one
/// path on a machine that has more.
///
/// ```
/// use gradreel::scalar::Path;
///
/// assert_eq!(Path::available().next(), Some(Path::Portable));
/// println!("kernels run on {}", Path::best());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// Plain Rust over small arrays; the compiler's baseline instruction set.
    Portable,
    /// 256-bit vectors with fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// 128-bit vectors with fused multiply-add.
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// One more than the number of the path that all kernels are held to; 0 where they are free.
static HELD: AtomicU8 = AtomicU8::new(0);

impl Path {
    /// The environment variable that names the path of a run; it is read once.
    ///
    /// ```
    /// use gradreel::scalar::Path;
    /// assert_eq!(Path::VARIABLE, "GRADREEL_ISA");
    /// ```
    pub const VARIABLE: &'static str = "GRADREEL_ISA";

    /// Every path that this processor can run.
    ///
    /// ```
    /// use gradreel::scalar::Path;
    /// assert!(Path::available().any(|path| path == Path::Portable));
    /// ```
    pub fn available() -> impl DoubleEndedIterator<Item = Self> {
        [
            Some(Self::Portable),
            #[cfg(target_arch = "x86_64")]
            (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            is_x86_feature_detected!("avx512f").then_some(Self::Avx512),
            #[cfg(target_arch = "aarch64")]
            std::arch::is_aarch64_feature_detected!("neon").then_some(Self::Neon),
        ]
        .into_iter()
        .flatten()
    }

    /// Every path that kernels are compiled for on this kind of processor.
    const ALL: &'static [Self] = &[
        Self::Portable,
        #[cfg(target_arch = "x86_64")]
        Self::Avx2,
        #[cfg(target_arch = "x86_64")]
        Self::Avx512,
        #[cfg(target_arch = "aarch64")]
        Self::Neon,
    ];

    /// Its name: `scalar`, `avx2`, `avx512` or `neon`.
    ///
    /// ```
    /// assert_eq!(gradreel::scalar::Path::Portable.name(), "scalar");
    /// ```
    pub const fn name(self) -> &'static str {
        match self {
            Self::Portable => "scalar",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "avx512",
            #[cfg(target_arch = "aarch64")]
            Self::Neon => "neon",
        }
    }

    /// The path of this name.
    ///
    /// ```
    /// use gradreel::scalar::Path;
    /// assert_eq!(Path::named("scalar")?, Path::Portable);
    /// assert!(Path::named("mmx").is_err());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is none of this name on this kind of processor, or when this processor lacks it.
    pub fn named(name: &str) -> Result<Self> {
        let here = || Self::available().map(Self::name).collect::<Vec<_>>().join(", ");
        let wrong = |what: &str| {
            let error = Error::new(ErrorKind::Input, what).at(Self::VARIABLE).found(format!("`{name}`"));
            error
                .wanted(format!("one of {}", here()))
                .fix(format!("unset {}, which takes the widest one", Self::VARIABLE))
        };
        let path = Self::ALL.iter().copied().find(|path| path.name() == name);
        let path = path.ok_or_else(|| wrong("no such instruction set"))?;
        match Self::available().any(|available| available == path) {
            true => Ok(path),
            false => Err(wrong("this processor lacks the instruction set")),
        }
    }

    /// The path that the environment asks for: the one that [`Path::VARIABLE`] names, or the widest available one.
    ///
    /// ```
    /// let path = gradreel::scalar::Path::of_environment()?; // GRADREEL_ISA, or the widest
    /// println!("{path}");
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Path::named`].
    pub fn of_environment() -> Result<Self> {
        static CHOSEN: OnceLock<Result<Path>> = OnceLock::new();
        let choose = || match std::env::var_os(Self::VARIABLE) {
            Some(name) => Self::named(&name.to_string_lossy()),
            None => Ok(Self::available().next_back().unwrap_or(Self::Portable)),
        };
        CHOSEN.get_or_init(choose).clone()
    }

    /// The path that kernels run on: that of the environment, unless they are held to another.
    ///
    /// ```
    /// use gradreel::scalar::Path;
    /// println!("kernels run on {:?}", Path::best());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the environment asks for one that this processor cannot run; [`Path::of_environment`] returns that as an error.
    #[inline]
    pub fn best() -> Self {
        static BEST: OnceLock<Path> = OnceLock::new();
        let held = HELD.load(Ordering::Relaxed);
        if held == 0 {
            return *BEST.get_or_init(|| Self::of_environment().unwrap_or_else(|error| panic!("{error}")));
        }
        Self::available().find(|path| *path as u8 + 1 == held).unwrap_or(Self::Portable)
    }

    /// Holds all kernels of the process to one path, or lets them go: to compare paths with each other, or with another
    /// machine.
    ///
    /// ```standalone_crate
    /// use gradreel::scalar::Path;
    ///
    /// let plain = Path::available().find(|path| path.name() == "scalar").expect("every processor runs plain code");
    /// // SAFETY: no kernel is running.
    /// unsafe { Path::hold(Some(plain)) };
    /// assert_eq!(gradreel::isa(), "scalar");
    /// unsafe { Path::hold(None) };
    /// ```
    ///
    /// # Safety
    /// No kernel may be running on any thread: some ask for the path more than once, and lay out memory by the first answer.
    ///
    /// # Panics
    /// When the processor cannot run it.
    pub unsafe fn hold(path: Option<Self>) {
        if let Some(path) = path {
            assert!(Self::available().any(|available| available == path), "this processor cannot run {path:?}");
        }
        HELD.store(path.map_or(0, |path| path as u8 + 1), Ordering::Relaxed);
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
