#include <fmt/format.h>

#include "experiments/command/commands.h"
#include "experiments/command/study_run.h"

namespace palpate::experiments {

int run_replay(const RunArguments& arguments, Context& context) {
  if (arguments.renderers.find(',') != std::string::npos)
    return fail({"replay runs one renderer", "`palpate compare` runs several", {}, 0}, kExitBadInput);
  return run_study(StudyKind::kReplay, arguments, context,
                   [](const OutputFolder& folder) -> Result<std::string> {
                     return fmt::format("results: {}\n", folder.path().string());
                   });
}

}  // namespace palpate::experiments
