// Memory of two renderers on one scan in one process, with a model store and without: what each says it
// holds, and what the process really grew by.
//
//   shared_models SCAN [RENDERER [RENDERER]]      dragon_vrip.ply.gz cloud cloud:shading=none
#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "baselines/register.h"
#include "toolkit/core/numbers.h"
#include "toolkit/io/read_model.h"
#include "toolkit/render/model_store.h"
#include "toolkit/renderers/toolkit_renderers.h"

namespace palpate {
namespace {

/// What the process has in memory now, bytes; what was freed is given back first.
double resident() {
  malloc_trim(0);
  std::ifstream file("/proc/self/statm");
  double pages = 0.0, in_memory = 0.0;
  file >> pages >> in_memory;
  return in_memory * static_cast<double>(sysconf(_SC_PAGESIZE));
}

/// Prepares the renderers one after the other, keeps them all, and says what that took.
void show(const char* what, const std::vector<std::string>& names, const render::Registry& registry,
          const render::SceneInput& scene, render::ModelStore* store) {
  const double before = resident();
  std::vector<std::unique_ptr<render::HapticRenderer>> held;
  double said = 0.0, ms = 0.0;
  for (const std::string& name : names) {
    const NamedOptions named = parse_named_options(name).value();
    held.push_back(registry.make(named.name, named.options).value());
    render::PrepareContext context;
    context.store = store;
    const Result<render::PrepareReport> report = held.back()->prepare(scene, context);
    if (!report) {
      fmt::print(stderr, "{}\n", report.error().message());
      std::exit(1);
    }
    said += static_cast<double>(report->bytes - report->shared_bytes);
    ms += report->total_ms;
  }
  fmt::print("{:<34}{:>12} held   {:>12} more in the process   {:>10} of preparation\n", what,
             bytes_text(said), bytes_text(resident() - before), duration_text(ms));
}

int run(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "usage: shared_models SCAN [RENDERER [RENDERER]]\n");
    return 2;
  }
  io::Readers readers;
  io::add_standard_readers(readers);
  Result<io::ReadModel> model = readers.read(argv[1], {});
  if (!model) {
    fmt::print(stderr, "{}\n", model.error().message());
    return 2;
  }
  render::SceneInput scene;
  render::ModelInput input;
  input.name = argv[1];
  input.cloud = std::make_shared<cloud::Cloud>(std::move(model->cloud));
  input.original_mesh = model->mesh;
  scene.models.push_back(std::move(input));
  const std::string first = argc > 2 ? argv[2] : "cloud", second = argc > 3 ? argv[3] : first;
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  fmt::print("{} points\n", count_text(scene.models[0].cloud->size()));
  render::ModelStore store;
  show("one renderer", {first}, registry, scene, nullptr);
  show("two, each with its own", {first, second}, registry, scene, nullptr);
  show("two, with a model store", {first, second}, registry, scene, &store);
  return 0;
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) {
  return palpate::run(argc, argv);
}
