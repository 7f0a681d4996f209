#include "experiments/behaviours/watch.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

#include "experiments/behaviours/matrix.h"
#include "experiments/session/run_key.h"
#include "experiments/session/terminal.h"

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

int watch_behaviours(const BehavioursArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  std::vector<RendererRequest> renderers = methods_of(registry);
  if (!arguments.renderers.empty()) {
    Result<std::vector<RendererRequest>> named = parse_renderers(arguments.renderers, registry);
    if (!named) return fail(named.error(), kExitBadInput);
    renderers = *std::move(named);
  }
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  Result<std::vector<Behaviour>> suite = behaviour_suite(context.progress);
  if (!suite) return fail(suite.error(), kExitFellShort, &context.progress);
  suite = chosen(*std::move(suite), arguments.only);
  if (!suite) return fail(suite.error(), kExitBadInput, &context.progress);
  RunKey key;
  key.add(arguments.only).add(static_cast<std::uint64_t>(arguments.threads));
  if (const Status begun = begin_run(*folder, key.word(), context); !begun)
    return fail(begun.error(), kExitFellShort, &context.progress);
  const KeptRows rows = {[&](const RendererRequest& request, KeptRows::Row& row) {
                           return folder->take_over(
                               request.label, key_of(request),
                               [&](const std::string& text) { return from_text(text, row); });
                         },
                         [&](const RendererRequest& request, const KeptRows::Row& row) {
                           return folder->keep(request.label, key_of(request), to_text(row));
                         }};
  const Result<BehaviourMatrix> matrix = run_behaviours(*std::move(suite), std::move(renderers), registry,
                                                        arguments.threads, context.progress, &rows);
  if (!matrix) return fail(matrix.error(), kExitFellShort, &context.progress);
  context.progress.report("drawing the report", -1.0);
  Page page = begin_page("How haptic renderers behave", new_head(context.command_line));
  add_behaviours(page, *matrix, *folder);
  const std::string json = matrix_json(*matrix);
  Status written = folder->write("behaviours.json", json);
  if (written) written = write_page(page, *folder);
  if (written) written = folder->complete();
  context.progress.clear();
  if (!written) return fail(written.error(), kExitFellShort);
  if (arguments.json)
    fmt::print("{}", json);
  else
    fmt::print("{}\nreport: {}\n", to_text(matrix_table(*matrix), terminal_columns(STDOUT_FILENO)),
               std::filesystem::absolute(folder->file("report.html")).string());
  return kExitOk;
}

}  // namespace palpate::experiments
