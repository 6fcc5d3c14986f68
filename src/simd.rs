//! Hot loops compiled more than once: for any processor, for those with AVX2, and where it gains for those with AVX-512.
//!
//! Only the width of the registers differs. Multiplications and additions are not fused and sums
//! keep their order, so all give the same bits. (Fused, the innermost loops of a sweep took 10 to 30 %
//! less time on a Zen 3 processor, but a processor without the instruction would need a call of a
//! library function for every product to get the same bits.)

/// A hot loop with all it needs.
pub trait HotLoop {
    /// What it computes.
    type Output;

    /// Does the work. Mark it, and all it calls, `#[inline(always)]`: only code that is inlined
    /// here is compiled for the wider registers.
    fn run(self) -> Self::Output;
}

/// Runs `work`, compiled for AVX2 where the processor has it.
#[inline]
pub fn wide<K: HotLoop>(work: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: calling a function compiled for AVX2 needs a processor that has it, and this
        // one was asked a line above. The function has no other requirement.
        #[allow(unsafe_code)]
        return unsafe { with_avx2(work) };
    }
    work.run()
}

/// Runs `work`, compiled for AVX-512 where the processor has it, else as [`wide`] does. For long loops over few kinds of
/// numbers; where it does not gain, `wide` is less code.
#[inline]
pub fn widest<K: HotLoop>(work: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if has_avx512() {
        // SAFETY: as in `wide`; the processor was asked for all that the function is compiled for.
        #[allow(unsafe_code)]
        return unsafe { with_avx512(work) };
    }
    wide(work)
}

/// Asks for the line of the cache in which `of` begins. Nobody waits for it: what else there is to do is done meanwhile.
#[inline(always)]
pub fn fetch<T>(of: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: this is a hint that changes nothing but what the caches hold. It would be sound for any address; this
        // one is that of a reference.
        #[allow(unsafe_code)]
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(of).cast());
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = of;
}

#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    use std::arch::is_x86_feature_detected as has;
    has!("avx512f") && has!("avx512bw") && has!("avx512dq") && has!("avx512vl")
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<K: HotLoop>(work: K) -> K::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn with_avx512<K: HotLoop>(work: K) -> K::Output {
    work.run()
}
