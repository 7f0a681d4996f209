#include "tests/house/corpus_scene.h"

#include <palpate/registry.h>

#ifdef PALPATE_WITH_BASELINES
#include <palpate/baselines.h>
#endif

namespace palpate::house {

render::Registry all_renderers() {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
#ifdef PALPATE_WITH_BASELINES
  baselines::register_baseline_renderers(registry);
#endif
  return registry;
}

}  // namespace palpate::house
