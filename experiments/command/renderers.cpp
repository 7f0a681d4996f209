#include <fmt/format.h>

#include "experiments/command/catalogue.h"
#include "experiments/command/subcommands.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

namespace {

struct RenderersArguments {
  std::string name;  ///< empty: all
  bool json = false;
};

void declare_renderers(const Declaration& declare, RenderersArguments& a) {
  declare.text("NAME", a.name, "show this one alone (default: all)");
  declare.flag("--json", a.json, "print JSON");
}

int run_renderers(const RenderersArguments& arguments, Context& /*context*/) {
  const render::Registry registry = all_renderers();
  std::vector<CatalogueEntry> entries;
  for (const render::RendererInfo& info : registry.all())
    entries.push_back({info.name, info.summary, info.source, info.options, std::string(name_of(info.role)),
                       std::string(name_of(info.geometry)), names_of(info.supports)});
  if (const Status found = keep_named(entries, arguments.name); !found)
    return fail(found.error(), kExitBadInput);
  print_catalogue(entries, arguments.json);
  if (!arguments.json)
    fmt::print(
        "Options follow the name after colons, as in cloud:shading=none; label=TEXT names one used twice;\n"
        "clean=STEP+STEP cleans the points before (`palpate clean` lists the steps).\n");
  return kExitOk;
}

}  // namespace

Subcommand renderers_subcommand() {
  return subcommand("renderers", "the renderers with their options, defaults and sources",
                    {"palpate renderers", "palpate renderers cloud"}, declare_renderers, run_renderers);
}

}  // namespace palpate::experiments
