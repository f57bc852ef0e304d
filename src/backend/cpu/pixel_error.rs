//! How sure the pixels are: the spread over replicates, and the bias of the voxels' size.

use super::gather::Volumes;
use crate::backend::Device;
use crate::error::Result;
use crate::scene::Camera;
use rayon::prelude::*;

/// Mean and standard error of each value over `k` replicates (the replicate fastest).
pub fn spread(values: &[f32], k: usize) -> (Vec<f32>, Vec<f32>) {
    values
        .par_chunks(k)
        .map(|list| {
            let mean = list.iter().map(|&x| f64::from(x)).sum::<f64>() / k as f64;
            let m2 = list.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>();
            let error = if k > 1 { (m2 / (k as f64 * (k as f64 - 1.0))).sqrt() } else { f64::INFINITY };
            (mean as f32, error as f32)
        })
        .unzip()
}

/// The estimated bias of orders >= 2 in each pixel. The mean over a voxel adds h^2/24 of each second derivative to J, and
/// linear interpolation h^2/12 more on average: together what one pass of (1/8, 6/8, 1/8) along each axis adds. So the
/// image of the smoothed volume less that of the volume is the bias, to second order.
pub fn bias(
    device: &Device,
    volumes: &Volumes,
    source: &[f32],
    camera: &Camera,
    pixels: Option<&[usize]>,
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Vec<f32>> {
    let n = volumes.scene.medium.volume.n();
    let mut difference = smooth(source, n, volumes.channels, stop);
    difference.par_iter_mut().zip(source).for_each(|(s, j)| *s -= j);
    let change = Volumes {
        scene: volumes.scene,
        occupancy: volumes.occupancy,
        lights: Vec::new(),
        source: Some(&difference),
        source0: None,
        channels: volumes.channels,
    };
    Ok(device.image(&change, camera, pixels, volumes.channels, false, stop)?.order2)
}

/// One pass of (1/8, 6/8, 1/8) along each axis, clamped at the border.
fn smooth(values: &[f32], n: [usize; 3], channels: usize, stop: &(impl Fn() -> bool + Sync)) -> Vec<f32> {
    let (row, slice) = (channels * n[0], channels * n[0] * n[1]);
    let mut now = values.to_vec();
    for (stride, m) in [(channels, n[0]), (row, n[1]), (slice, n[2])] {
        let before = now.clone();
        now.par_chunks_mut(row).enumerate().for_each(|(at, out)| {
            if stop() {
                return;
            }
            let from = at * row;
            for (x, value) in out.iter_mut().enumerate() {
                let at = from + x;
                let i = at / stride % m;
                let low = before[if i > 0 { at - stride } else { at }];
                let high = before[if i + 1 < m { at + stride } else { at }];
                *value = 0.75 * before[at] + 0.125 * (low + high);
            }
        });
    }
    now
}

/// sqrt(mean(error^2)) and sqrt(mean(bias^2)) over mean(value), of the channel in which both together are worst, over the
/// places above 5 % of the channel's maximum.
pub fn relative(values: &[f32], errors: &[f32], bias: Option<&[f32]>, channels: usize) -> (f64, f64) {
    let mut worst = (0.0f64, 0.0f64);
    for c in 0..channels {
        let pick = |list: &[f32], at: usize| f64::from(list[at * channels + c]);
        let places = values.len() / channels;
        let top = (0..places).map(|at| pick(values, at)).fold(0.0, f64::max);
        let (mut sum, mut noise, mut biased, mut count) = (0.0, 0.0, 0.0, 0.0);
        for at in 0..places {
            let value = pick(values, at);
            if value > 0.05 * top {
                count += 1.0;
                sum += value;
                noise += pick(errors, at).powi(2);
                biased += bias.map_or(0.0, |b| pick(b, at).powi(2));
            }
        }
        if sum > 0.0 {
            let of = |square: f64| (square / count).sqrt() / (sum / count);
            let here = (of(noise), of(biased));
            if here.0.hypot(here.1) > worst.0.hypot(worst.1) {
                worst = here;
            }
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_the_standard_error_of_the_mean() {
        let (mean, error) = spread(&[1.0, 2.0, 3.0, 4.0, 5.0, 5.0, 5.0, 5.0], 4);
        assert_eq!(mean, vec![2.5, 5.0]);
        assert!((f64::from(error[0]) - (5.0f64 / 12.0).sqrt()).abs() < 1e-6 && error[1] == 0.0);
    }

    #[test]
    fn smoothing_adds_an_eighth_of_the_second_difference() {
        let squares: Vec<f32> = (0..9).map(|i| (i * i) as f32).collect();
        let smoothed = smooth(&squares, [9, 1, 1], 1, &|| false);
        assert!((smoothed[4] - 16.25).abs() < 1e-6);
    }
}
