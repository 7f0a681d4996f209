// The C interface between Palpate and a plug-in: a module that speaks with the closed library of a device's
// maker. Palpate never links such a library; it loads the plug-in at run time, and what is not there is said
// by `palpate devices`. Plain C, so that a plug-in may be built by any compiler, at any time.
//
// Units: mm, N, s; the device's frame, right-handed. Every function may be called once the one before it in
// this list has answered well; none throws. Texts are UTF-8, ended by a zero, cut to their size.
#pragma once

#include <stdint.h>  // NOLINT: C

#ifdef __cplusplus
extern "C" {
#endif

/// Goes up when anything below changes its meaning. A plug-in of another number is not used.
#define PALPATE_PLUGIN_ABI 1u
/// The one symbol that a plug-in exports.
#define PALPATE_PLUGIN_ENTRY "palpate_plugin_entry"

typedef struct palpate_plugin_limits {  // NOLINT: C
  double force_max_n;                   ///< continuous, in any direction; above 0
  double low_mm[3], high_mm[3];         ///< workspace
  double resolution_mm;
  double rate_hz;
  double stiffness_max_n_per_mm;  ///< 0: not known
  double damping_max_n_s_per_mm;  ///< 0: not known
  uint32_t shape;                 ///< 0 box, 1 ellipsoid, 2 cylinder about z
  uint32_t reserved;
} palpate_plugin_limits;

typedef struct palpate_plugin_state {  // NOLINT: C
  double position_mm[3];
  int64_t age_ns;    ///< since it was measured
  uint32_t status;   ///< 0 fresh, 1 nothing new, 2 nonsense, 3 gone
  uint32_t homed;    ///< 1: its zero is known
  uint32_t buttons;  ///< one bit each
  uint32_t reserved;
} palpate_plugin_state;

typedef struct palpate_plugin {  // NOLINT: C
  uint32_t abi;                  ///< PALPATE_PLUGIN_ABI
  uint32_t size;                 ///< of this struct
  const char* name;              ///< of the driver, as in "NAME" or "NAME:1"
  const char* what;              ///< a part of a sentence for people

  /// How many devices are connected; below 0: the library cannot work here. `text`: which, or why not.
  int32_t (*look)(char* text, uint32_t size);
  /// The device of this index, with zero force commanded. Null: `text` says why. May take long.
  void* (*open)(uint32_t index, char* text, uint32_t size);
  /// Zero force, and lets the device go.
  void (*close)(void* device);
  /// 0: good.
  int32_t (*limits)(void* device, palpate_plugin_limits* limits);
  /// The newest state. 0: good. Never blocks, never allocates.
  int32_t (*read)(void* device, palpate_plugin_state* state);
  /// Commands a force. 0: good. Never blocks, never allocates. Without a call for longer than 50 ms the
  /// plug-in itself commands zero.
  int32_t (*send)(void* device, const double force_n[3]);
  /// Commands zero, from any thread, at any time until close. 0: good. Never blocks, never allocates.
  int32_t (*zero)(void* device);
  /// What the device says of itself, as lines "key=value". 0: good.
  int32_t (*facts)(void* device, char* text, uint32_t size);
} palpate_plugin;

/// What PALPATE_PLUGIN_ENTRY is. The struct lives as long as the module.
typedef const palpate_plugin* (*palpate_plugin_entry_fn)(void);  // NOLINT: C

#ifdef __cplusplus
}
#endif
