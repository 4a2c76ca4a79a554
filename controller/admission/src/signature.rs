//! Proof that a policy was published by somebody who may: minisign signatures (Ed25519).

use std::path::{Path, PathBuf};

use minisign_verify::{PublicKey, Signature};

/// Largest signature file that is read; minisign's have some 300 bytes.
const MOST_SIGNATURE_BYTES: usize = 4096;

/// Rule on signatures.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum SignatureRule {
    /// None is asked for.
    #[default]
    None,
    /// A sound signature by this key beside the file.
    Required(PublicKey),
}

/// Reason why a key cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("`{text}` is no minisign public key ({problem}); give the line of a .pub file that begins with RW")]
pub struct KeyError {
    text: String,
    problem: String,
}

impl SignatureRule {
    /// The rule for a key, as the second line of minisign's `.pub` file has it.
    ///
    /// # Errors
    /// If it is no key.
    pub fn required(key: &str) -> Result<Self, KeyError> {
        PublicKey::from_base64(key.trim())
            .map(SignatureRule::Required)
            .map_err(|error| KeyError { text: key.trim().to_owned(), problem: error.to_string() })
    }

    /// Checks the signature that stands beside a policy file, over the bytes that were read of it.
    ///
    /// # Errors
    /// One line that says what is missing or wrong.
    pub fn check(&self, policy: &Path, bytes: &[u8]) -> Result<(), String> {
        let SignatureRule::Required(key) = self else { return Ok(()) };
        let file = signature_file(policy);
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = policy::read(&file, policy::Links::Refuse).map_err(|fault| {
            format!(
                "policy.require_signature asks for a signature: {name} {fault}; sign with `minisign -S -m {}`",
                policy.display()
            )
        })?;
        if text.len() > MOST_SIGNATURE_BYTES {
            return Err(format!("{name} has {} bytes and is no minisign signature", text.len()));
        }
        let text = String::from_utf8(text).map_err(|_| format!("{name} is no text, so no minisign signature"))?;
        let signature =
            Signature::decode(&text).map_err(|error| format!("{name} is no minisign signature ({error})"))?;
        // Signatures of the old kind hash nothing, and would do as well; the file is small.
        key.verify(bytes, &signature, true).map_err(|error| {
            format!("{name} is no signature of this file by policy.public_key ({error}); sign it again")
        })
    }
}

/// The file beside a policy that holds its signature.
pub fn signature_file(policy: &Path) -> PathBuf {
    let mut name = policy.as_os_str().to_owned();
    name.push(".minisig");
    PathBuf::from(name)
}
