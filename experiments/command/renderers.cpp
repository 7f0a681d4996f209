#include <fmt/format.h>

#include "experiments/command/catalogue.h"
#include "experiments/command/commands.h"
#include "experiments/command/session.h"

namespace palpate::experiments {

int run_renderers(const RenderersArguments& arguments) {
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

}  // namespace palpate::experiments
