// Renderers of plug-ins (palpate/renderer_plugin.h). A header of its own, so that who makes a registry needs
// neither the C interface nor the loader.
#pragma once

#include <palpate/registry.h>

namespace palpate::render {

/// Adds every renderer-NAME.so of the plug-in folders (toolkit/core/plugin_module.h) as NAME; a taken name is
/// not replaced. A library is loaded by decide() or prepare() alone, whose Error says what is wrong with it:
/// naming or listing one runs nothing of it. Register them last.
void register_plugin_renderers(Registry& registry);

}  // namespace palpate::render
