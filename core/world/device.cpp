// SPDX-License-Identifier: Apache-2.0
#include "core/world/device.h"

#include "core/host/plugin_host.h"
#include "core/math/problem.h"

#include <new>

namespace marram {
namespace {

void on_device_error(void* user, RTCError code, const char* text) {
    DeviceErrors& errors = *static_cast<DeviceErrors*>(user);
    const std::lock_guard guard(errors.lock);
    if (errors.code != RTC_ERROR_NONE) return;
    errors.code = code;
    errors.text = text ? text : "";
}

} // namespace

std::shared_ptr<RTCDeviceTy> make_device(std::shared_ptr<DeviceErrors>& errors) {
    errors = std::make_shared<DeviceErrors>();
    // Embree's tasks run in the caller's arena; it must not start its own threads or pin ours to cores.
    RTCDevice device = rtcNewDevice("set_affinity=0,start_threads=0");
    if (!device) {
        const RTCError code = rtcGetDeviceError(nullptr);
        if (code == RTC_ERROR_UNSUPPORTED_CPU)
            throw InputError({"embree"}, "Embree does not run on this processor", "use one that has SSE2");
        throw std::bad_alloc(); // otherwise it lacks memory, possibly for threads' stacks
    }
    rtcSetDeviceErrorFunction(device, on_device_error, errors.get());
    return {device, [errors](RTCDevice d) { rtcReleaseDevice(d); }};
}

void clear_errors(DeviceErrors& errors) {
    const std::lock_guard guard(errors.lock);
    errors.code = RTC_ERROR_NONE;
    errors.text.clear();
}

void raise(DeviceErrors& errors) {
    const std::lock_guard guard(errors.lock);
    if (errors.code == RTC_ERROR_NONE) return;
    if (errors.code == RTC_ERROR_CANCELLED) throw Cancelled{};
    const bool memory = errors.code == RTC_ERROR_OUT_OF_MEMORY;
    throw InputError({"embree"},
                     memory ? "the scene does not fit into memory" : "Embree failed: " + errors.text,
                     memory ? "use fewer strands, CVs or motion keys" : "report it with the scene");
}

} // namespace marram
