//! The program of a plug-in, in the unit of the plug-in.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use command::{Answer, Failure};
use config::SystemFile;

use crate::plugin::{NAMES, TEMPLATE, WITH_NETWORK};
use crate::settings::{Args, instance};

/// Becomes the program of a plug-in, with the gateway's socket and its own name in its environment; or only checks that
/// there is one. To be called in the unit of the plug-in.
///
/// # Errors
/// The system file declares no such program, or declares it for the other template; it cannot be started. On success it
/// returns only from a check.
pub fn exec(args: &Args, plugin: &str, socket: &Path) -> Answer {
    let path = args.system_file()?;
    let (system, file) = (path.display(), SystemFile::load(&path).map_err(Failure::bad)?);
    let unknown = || Failure::BadInput(format!("{system} declares no [[plugin]] \"{plugin}\" with a command"));
    let declared = file.plugin.iter().find(|one| one.name == plugin).ok_or_else(unknown)?;
    if declared.network != args.network {
        let (is, template) = (declared.network, if declared.network { WITH_NETWORK } else { TEMPLATE });
        let why =
            format!("{system} has network = {is} for the [[plugin]] \"{plugin}\"; start it in a unit of {template}@");
        return Err(Failure::BadInput(why));
    }
    let instance = instance(&path);
    if instance.len() + plugin.len() > NAMES {
        let why = format!(
            "`{instance}` and `{plugin}` have more than {NAMES} characters together, so that the plug-in would have no \
             user of its own; shorten the name of {system} or that of the [[plugin]]"
        );
        return Err(Failure::BadInput(why));
    }
    let (program, arguments) = declared.command.split_first().ok_or_else(unknown)?;
    if args.declared {
        return Ok(());
    }
    let error = Command::new(program)
        .args(arguments)
        .env("NIMS_GATEWAY", socket)
        .env("NIMS_NAME", plugin)
        .env_remove("NIMS_TOKEN")
        .exec();
    Err(Failure::NotNow(format!("{program} cannot be started: {error}")))
}
