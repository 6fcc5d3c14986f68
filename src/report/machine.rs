//! The machine a figure was measured on.

use serde::Serialize;

/// Processor and threads.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Model name as the system gives it.
    pub processor: String,
    /// Threads the run used.
    pub threads: usize,
}

impl Machine {
    /// This machine, now.
    pub fn this() -> Self {
        let processor = std::fs::read_to_string("/proc/cpuinfo")
            .ok()
            .and_then(|text| {
                let line = text.lines().find(|l| l.starts_with("model name"))?;
                Some(line.split_once(':')?.1.trim().to_owned())
            })
            .unwrap_or_else(|| std::env::consts::ARCH.to_owned());
        Machine { processor, threads: rayon::current_num_threads() }
    }
}

/// Largest resident memory of this process so far, bytes; 0 where the system does not tell.
pub fn peak_memory_bytes() -> u64 {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|text| {
            let line = text.lines().find(|l| l.starts_with("VmHWM:"))?;
            line.split_whitespace().nth(1)?.parse::<u64>().ok()
        })
        .map_or(0, |kilobytes| kilobytes * 1024)
}

/// Time that all processors together have spent on this process, s, in steps of a hundredth; 0 where the system does
/// not tell.
pub fn processor_s() -> f64 {
    // The ticks that proc(5) counts in have been hundredths of a second on all of Linux for long.
    const TICK_S: f64 = 0.01;
    let ticks = std::fs::read_to_string("/proc/self/stat").ok().and_then(|text| {
        // The name before the last parenthesis may hold anything; then user and system time are fields 12 and 13.
        let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
        Some(fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?)
    });
    TICK_S * ticks.unwrap_or(0.0)
}

/// Makes [`peak_memory_bytes`] begin anew from what the process holds now. Where the system does not let it,
/// nothing changes, and the peak stays that of the whole run.
pub fn reset_peak_memory() {
    // The kernel's name for it is 5 (proc(5)); there is nothing to do about a refusal.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
