#include "toolkit/render/registry.h"

#include <fmt/format.h>

#include <cassert>

#include "toolkit/render/analytic_renderer.h"
#include "toolkit/render/brute_force_renderer.h"
#include "toolkit/render/cloud_literal_renderer.h"
#include "toolkit/render/cloud_renderer.h"
#include "toolkit/render/heightfield_literal_renderer.h"
#include "toolkit/render/heightfield_renderer.h"

namespace palpate::render {

void Registry::add(RendererInfo info) {
  assert(find(info.name) == nullptr);
  renderers_.push_back(std::move(info));
}

const RendererInfo* Registry::find(std::string_view name) const noexcept {
  for (const RendererInfo& info : renderers_)
    if (info.name == name) return &info;
  return nullptr;
}

Result<std::unique_ptr<HapticRenderer>> Registry::make(std::string_view name, const Options& options) const {
  const RendererInfo* info = find(name);
  if (info == nullptr) {
    std::string known;
    for (const RendererInfo& r : renderers_) known.append(known.empty() ? "" : ", ").append(r.name);
    return Error{fmt::format("there is no renderer '{}'", name), "choose from " + known, {}, 0};
  }
  Result<Options> complete = validate(options, info->options, name);
  if (!complete) return std::move(complete).error();
  return info->make(*complete);
}

void register_toolkit_renderers(Registry& registry) {
  registry.add(cloud_literal_info());
  registry.add(cloud_info());
  registry.add(heightfield_literal_info());
  registry.add(heightfield_info());
  registry.add(analytic_renderer_info());
  registry.add(brute_force_info());
}

}  // namespace palpate::render
