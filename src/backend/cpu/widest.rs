//! Loops compiled once per instruction set, the widest of which is picked at run time.

/// Defines a function that runs `$body::<T, FUSED>` with the widest vectors of the processor. The body must be
/// `#[inline(always)]` and hold plain loops: closures and iterator adaptors would not inherit the instruction set. `FUSED`
/// says whether the processor has a fused multiply-add; see [`fused`].
macro_rules! widest {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)? = $body:ident) => {
        $(#[$doc])*
        $vis fn $name<T: $crate::scalar::Real>($($argument: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx2,fma")]
                fn avx512<T: $crate::scalar::Real>($($argument: $type),*) $(-> $result)? {
                    $body::<T, true>($($argument),*)
                }
                #[target_feature(enable = "avx2,fma")]
                fn avx2<T: $crate::scalar::Real>($($argument: $type),*) $(-> $result)? {
                    $body::<T, true>($($argument),*)
                }
                if is_x86_feature_detected!("avx512f") {
                    // SAFETY: the instruction set was detected.
                    return unsafe { avx512::<T>($($argument),*) };
                }
                if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                    // SAFETY: as above.
                    return unsafe { avx2::<T>($($argument),*) };
                }
            }
            $body::<T, { cfg!(target_arch = "aarch64") }>($($argument),*)
        }
    };
}
pub(crate) use widest;

/// `a b + c`, rounded once where that is one instruction.
#[inline(always)]
pub(crate) fn fused<T: crate::scalar::Real, const FUSED: bool>(a: T, b: T, c: T) -> T {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}
