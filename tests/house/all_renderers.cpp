#include "tests/house/all_renderers.h"

namespace palpate::house {

void register_all_renderers(render::Registry& registry) {
  render::register_toolkit_renderers(registry);
}

}  // namespace palpate::house
