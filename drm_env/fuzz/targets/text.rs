#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| drm_env_fuzz::doors::text(data));
