//! Signatures: the published test vector of minisign over the four bytes `test`, and what must not pass.
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;

use admission::SignatureRule;
use admission::signature::signature_file;

/// Key and signature of the crate's own documentation: over `test`, prehashed (minisign's default).
const KEY: &str = "RWQf6LRCGA9i53mlYecO4IzT51TGPpvWucNSCh1CBM0QTaLn73Y7GFO3";
const SIGNATURE: &str = "untrusted comment: signature from minisign secret key\n\
RUQf6LRCGA9i559r3g7V1qNyJDApGip8MfqcadIgT9CuhV3EMhHoN1mGTkUidF/z7SrlQgXdy8ofjb7bNJJylDOocrCo8KLzZwo=\n\
trusted comment: timestamp:1633700835\tfile:test\tprehashed\n\
wLMDjy9FLAuxZ3q4NlEvkgtyhrr0gtTu6KC4KBJdITbbOeAi1zBIYo0v4iTgt8jJpIidRJnp94ABQkJAgAooBQ==\n";

#[test]
fn only_the_signed_bytes_pass() {
    let folder = std::env::temp_dir().join(format!("signatures-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let policy: PathBuf = folder.join("p.onnx");
    let rule = SignatureRule::required(KEY).unwrap();
    let refused = |bytes: &[u8]| rule.check(&policy, bytes).unwrap_err();
    assert!(refused(b"test").contains("p.onnx.minisig"), "without a signature: {}", refused(b"test"));
    assert_eq!(SignatureRule::None.check(&policy, b"test"), Ok(()));

    std::fs::write(signature_file(&policy), SIGNATURE).unwrap();
    assert_eq!(rule.check(&policy, b"test"), Ok(()));
    assert!(refused(b"Test").contains("no signature of this file"), "{}", refused(b"Test"));
    for spoilt in [
        SIGNATURE.replace("RUQf6", "RUQf7"),
        SIGNATURE.replace("timestamp:1633700835", "timestamp:1733700835"),
        "no signature".to_owned(),
        "x".repeat(10_000),
    ] {
        std::fs::write(signature_file(&policy), spoilt).unwrap();
        assert_eq!(refused(b"test").lines().count(), 1);
    }
    // A link may stand for anything.
    std::fs::write(folder.join("elsewhere"), SIGNATURE).unwrap();
    std::fs::remove_file(signature_file(&policy)).unwrap();
    std::os::unix::fs::symlink(folder.join("elsewhere"), signature_file(&policy)).unwrap();
    assert!(refused(b"test").contains("symbolic link"), "{}", refused(b"test"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_key_that_is_none_is_refused_by_name() {
    for key in ["", "RW", "not a key at all", "untrusted comment: minisign public key"] {
        let message = SignatureRule::required(key).unwrap_err().to_string();
        assert!(message.contains("RW") && message.lines().count() == 1, "{message}");
    }
}
