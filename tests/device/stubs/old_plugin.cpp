// A plug-in of another version, and one that is not whole: neither may be used.
#include "device/plugins/plugin.h"

extern "C" __attribute__((visibility("default"))) const palpate_plugin* palpate_plugin_entry() {
#ifdef PALPATE_STUB_HALF
  static const palpate_plugin plugin = {PALPATE_PLUGIN_ABI,
                                        sizeof(palpate_plugin),
                                        "half",
                                        "half",
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr};
#else
  static const palpate_plugin plugin = {PALPATE_PLUGIN_ABI + 1,
                                        16,
                                        "old",
                                        "old",
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr,
                                        nullptr};
#endif
  return &plugin;
}
