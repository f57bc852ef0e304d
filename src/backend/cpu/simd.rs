//! The same code compiled for several instruction sets, of which the best that the machine has is chosen at run time.
//!
//! A [`Kernel`] is ordinary Rust, inlined into one entry per instruction set, where the compiler turns its loops over lanes
//! into that set's vectors. No entry may contract a multiplication and an addition into one, so all give the same bits.

use crate::plan::Simd;

/// Code that gains from wide vectors. `run` and all that it calls in its loops must be `#[inline(always)]`.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// The best that this machine has.
pub fn best() -> Simd {
    #[cfg(target_arch = "x86_64")]
    {
        let avx2 = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt");
        if avx2
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512cd")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
        {
            return Simd::Avx512;
        }
        if avx2 {
            return Simd::Avx2;
        }
    }
    Simd::Baseline
}

/// Runs a kernel with the given instruction set, or the best that the machine has if it lacks that.
#[inline]
pub fn dispatch<K: Kernel>(simd: Simd, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[expect(unsafe_code, reason = "the features that the entry is compiled for were found on this machine")]
        match simd.min(best()) {
            Simd::Avx512 => return unsafe { avx512(kernel) },
            Simd::Avx2 => return unsafe { avx2(kernel) },
            Simd::Scalar | Simd::Baseline => {}
        }
    }
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl Kernel for Sum<'_> {
        type Output = f32;
        #[inline(always)]
        fn run(self) -> f32 {
            self.0.iter().fold(0.0, |sum, x| sum + 1.1 * x)
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let data: Vec<f32> = (0..1000).map(|i| (i as f32).sqrt()).collect();
        let expected = Sum(&data).run();
        for (simd, name) in Simd::ALL {
            assert_eq!(dispatch(simd, Sum(&data)).to_bits(), expected.to_bits(), "{name}");
            assert_eq!(name.parse::<Simd>().expect("a name"), simd);
        }
        assert!("sse".parse::<Simd>().is_err());
    }
}
