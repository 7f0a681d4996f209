// A plug-in of another version, and one that is not whole: neither may be used.
#include "device/plugins/plugin.h"

extern "C" __attribute__((visibility("default"))) const palpate_plugin* palpate_plugin_entry() {
  static palpate_plugin plugin{};  // without a function
#ifdef PALPATE_STUB_HALF
  plugin.abi = PALPATE_PLUGIN_ABI;
#else
  plugin.abi = PALPATE_PLUGIN_ABI + 1;
#endif
  plugin.size = sizeof plugin;
  plugin.name = plugin.what = "stub";
  return &plugin;
}
