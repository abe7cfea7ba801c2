//! Prints the JSON schema of an environment's configuration.

fn main() {
    use std::io::Write;
    let schema = drm_env::EnvConfig::schema();
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    let mut out = std::io::stdout().lock();
    // a reader that has gone away is not this program's failure
    let _ = writeln!(out, "{text}");
}
