#include <fmt/format.h>

#include <algorithm>

#include "experiments/behaviours/matrix.h"
#include "experiments/command/commands.h"
#include "experiments/command/session.h"

namespace palpate::experiments {
namespace {

/// The behaviours named in "a,b"; all where it is empty.
Result<std::vector<Behaviour>> chosen(std::vector<Behaviour> suite, const std::string& only) {
  if (only.empty()) return suite;
  std::string known;
  for (const Behaviour& behaviour : suite) known += (known.empty() ? "" : ", ") + behaviour.id;
  std::vector<std::string> names = split_list(only);
  for (const std::string& name : names)
    if (std::none_of(suite.begin(), suite.end(), [&](const Behaviour& b) { return b.id == name; }))
      return Error{fmt::format("there is no behaviour '{}'", name), "choose from " + known, {}, 0};
  std::erase_if(
      suite, [&](const Behaviour& b) { return std::find(names.begin(), names.end(), b.id) == names.end(); });
  return suite;
}

}  // namespace

int run_behaviours_command(const BehavioursArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  std::vector<RendererRequest> renderers = methods_of(registry);
  if (!arguments.renderers.empty()) {
    Result<std::vector<RendererRequest>> named = parse_renderers(arguments.renderers, registry);
    if (!named) return fail(named.error(), kExitBadInput);
    renderers = *std::move(named);
  }
  Result<std::vector<Behaviour>> suite = behaviour_suite(context.progress);
  if (!suite) return fail(suite.error(), kExitFellShort, &context.progress);
  suite = chosen(*std::move(suite), arguments.only);
  if (!suite) return fail(suite.error(), kExitBadInput, &context.progress);
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  const BehaviourMatrix matrix =
      run_behaviours(*std::move(suite), std::move(renderers), registry, arguments.threads, context.progress);
  if (context.progress.cancelled())
    return fail({"stopped", "nothing was written", {}, 0}, kExitFellShort, &context.progress);
  context.progress.report("drawing the report", -1.0);
  Page page = begin_page("How haptic renderers behave", new_document(context.command_line));
  add_behaviours(page, matrix, *folder);
  const std::string json = matrix_json(matrix);
  Status written = folder->write("behaviours.json", json);
  if (written) written = write_page(page, *folder);
  context.progress.clear();
  if (!written) return fail(written.error(), kExitFellShort);
  if (arguments.json)
    fmt::print("{}", json);
  else
    fmt::print("{}\nreport: {}\n", to_text(matrix_table(matrix)),
               std::filesystem::absolute(folder->file("report.html")).string());
  return kExitOk;
}

}  // namespace palpate::experiments
