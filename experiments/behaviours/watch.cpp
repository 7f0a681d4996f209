#include "experiments/behaviours/watch.h"

#include <fmt/format.h>

#include <algorithm>

#include "experiments/behaviours/matrix.h"

namespace palpate::experiments {
namespace {

/// The behaviours named in "a,b"; empty: all.
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

Result<int> watch_behaviours(const BehavioursArguments& arguments, Context& context) {
  Suite suite(context);
  const render::Registry registry = all_renderers();
  std::vector<RendererRequest> renderers = methods_of(registry);
  if (!arguments.renderers.empty()) {
    PALPATE_ASSIGN(renderers, parse_renderers(arguments.renderers, registry));
  }
  PALPATE_TRY(suite.open(arguments.out));
  PALPATE_ASSIGN(std::vector<Behaviour> all, behaviour_suite(suite.progress()));
  PALPATE_ASSIGN(std::vector<Behaviour> wanted, chosen(std::move(all), arguments.only));
  PALPATE_TRY(suite.begin(RunKey().add(arguments.only).add(static_cast<std::uint64_t>(arguments.threads))));
  PALPATE_ASSIGN(const BehaviourMatrix matrix,
                 run_behaviours(std::move(wanted), std::move(renderers), registry, arguments.threads,
                                suite.progress(), &suite));
  suite.progress().report("drawing the report", -1.0);
  Page page = begin_page("How haptic renderers behave", new_head(context.command_line));
  add_behaviours(page, matrix, suite.folder());
  PALPATE_TRY(
      suite.publish({"behaviours.json", matrix_json(matrix), {matrix_table(matrix)}}, page, arguments.json));
  return kExitOk;
}

}  // namespace palpate::experiments
