// SPDX-License-Identifier: Apache-2.0
#include "core/world/device.h"

#include "core/host/plugin_host.h"
#include "core/math/problem.h"

#include <new>

namespace marram {
namespace {

void on_device_error(void* user, RTCError code, const char* text) {
    DeviceState& state = *static_cast<DeviceState*>(user);
    const std::lock_guard guard(state.lock);
    if (state.code != RTC_ERROR_NONE) return;
    state.code = code;
    state.text = text ? text : "";
}

// done: what is told has been allocated or freed before. False: an allocation is to fail.
bool on_device_memory(void* user, ssize_t bytes, bool done) {
    DeviceState& state = *static_cast<DeviceState*>(user);
    const int64_t now = state.bytes.fetch_add(bytes, std::memory_order_relaxed) + bytes;
    if (bytes <= 0) return true;
    if (now > state.limit.load(std::memory_order_relaxed)) {
        if (!done) state.bytes.fetch_sub(bytes, std::memory_order_relaxed);
        return false;
    }
    for (int64_t peak = state.peak.load(std::memory_order_relaxed);
         now > peak && !state.peak.compare_exchange_weak(peak, now, std::memory_order_relaxed);) {
    }
    return true;
}

} // namespace

std::shared_ptr<RTCDeviceTy> make_device(std::shared_ptr<DeviceState>& state) {
    state = std::make_shared<DeviceState>();
    // Embree's tasks run in the caller's arena; it must not start its own threads or pin ours to cores.
    RTCDevice device = rtcNewDevice("set_affinity=0,start_threads=0");
    if (!device) {
        const RTCError code = rtcGetDeviceError(nullptr);
        if (code == RTC_ERROR_UNSUPPORTED_CPU)
            throw InputError({"embree"}, "Embree does not run on this processor", "use one that has SSE2");
        throw std::bad_alloc(); // otherwise it lacks memory, possibly for threads' stacks
    }
    rtcSetDeviceErrorFunction(device, on_device_error, state.get());
    rtcSetDeviceMemoryMonitorFunction(device, on_device_memory, state.get());
    return {device, [state](RTCDevice d) { rtcReleaseDevice(d); }};
}

void reset(DeviceState& state) {
    const std::lock_guard guard(state.lock);
    state.code = RTC_ERROR_NONE;
    state.text.clear();
    state.peak = state.bytes.load();
    state.limit = std::numeric_limits<int64_t>::max();
}

void raise(DeviceState& state) {
    const std::lock_guard guard(state.lock);
    if (state.code == RTC_ERROR_NONE) return;
    if (state.code == RTC_ERROR_CANCELLED) throw Cancelled{};
    const bool memory = state.code == RTC_ERROR_OUT_OF_MEMORY;
    throw InputError({"embree"},
                     memory ? "the scene does not fit into the memory that this process may take"
                            : "Embree failed: " + state.text,
                     memory ? "allow more with --memory, or use fewer strands, CVs or motion keys"
                            : "report it with the scene");
}

} // namespace marram
