//! Whether what is asked for fits into memory. An allocation that fails ends the process: so this is asked
//! before, of everything whose size follows from what somebody asks for.

use std::fmt::Display;

use crate::error::ConfigError;

/// What is not worth the question, bytes.
const SMALL: u128 = 16 << 20;

/// Refuses what would take more memory than there is, or than `most`, bytes (whole GiB); `less` is what
/// takes less.
///
/// # Errors
/// Names what was `given` and what it takes.
pub fn check(
    path: &str,
    given: impl Display,
    bytes: u128,
    most: Option<u64>,
    less: &str,
) -> Result<(), ConfigError> {
    if bytes <= SMALL {
        return Ok(());
    }
    let refused = |requirement: String| {
        let given = format!("{given}, which takes {}", size(bytes));
        Err(ConfigError::value(path, requirement, given))
    };
    if let Some(most) = most.filter(|most| bytes > u128::from(*most)) {
        let most = most >> 30;
        return refused(format!("must take at most {most} GiB ({less} takes less)"));
    }
    let free = free();
    if bytes > u128::from(free) {
        return refused(format!(
            "must fit into the {} of memory that are free ({less} takes less)",
            size(free.into())
        ));
    }
    // what the system lets this process have may be less, and other things come with it
    let probe = usize::try_from(bytes + bytes / 8);
    let fits = probe.is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok());
    if !fits {
        return refused(format!(
            "must fit into the memory that the system gives ({less} takes less)"
        ));
    }
    Ok(())
}

/// A number of bytes in a unit of its size.
fn size(bytes: u128) -> String {
    let (name, unit) = if bytes < 1 << 30 {
        ("MiB", 1_u64 << 20)
    } else {
        ("GiB", 1_u64 << 30)
    };
    format!("{:.1} {name}", bytes as f64 / unit as f64)
}

/// Memory that is free, bytes, as far as the system tells: pages without a better use, and the limit of
/// the container.
fn free() -> u64 {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let meminfo = read("/proc/meminfo");
    let entry = |name: &str| -> Option<u64> {
        let line = meminfo.lines().find(|line| line.starts_with(name))?;
        line.split_whitespace().nth(1)?.parse().ok()
    };
    let pages = entry("MemAvailable:").map(|kib| (kib + entry("SwapFree:").unwrap_or(0)) << 10);
    let container = [
        "/sys/fs/cgroup/memory.max",
        "/sys/fs/cgroup/memory/memory.limit_in_bytes",
    ];
    let limits = container
        .iter()
        .filter_map(|path| read(path).trim().parse().ok());
    limits.chain(pages).min().unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_fit_is_refused_with_its_size() {
        let asked = |bytes| check("count", 7, bytes, None, "fewer");
        assert_eq!(asked(1 << 20), Ok(()));
        let error = asked(1 << 70).expect_err("nobody has so much").to_string();
        assert!(error.starts_with("count must fit into the "), "{error}");
        assert!(
            error.ends_with("got 7, which takes 1099511627776.0 GiB"),
            "{error}"
        );
    }

    #[test]
    fn what_is_more_than_the_most_is_refused_whatever_there_is() {
        let error = check("count", "many", 3 << 30, Some(2 << 30), "a smaller one");
        assert_eq!(
            error.expect_err("it is too much").to_string(),
            "count must take at most 2 GiB (a smaller one takes less), got many, which takes 3.0 GiB"
        );
    }
}
