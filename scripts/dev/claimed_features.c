// SPDX-License-Identifier: GPL-3.0-or-later
// A Vulkan layer with which Blender starts on SwiftShader. It claims all features that Blender asks for, and takes those that the
// device lacks out of the call that creates it; what Blender draws with them is wrong, and Imprint needs none of them.
#include <string.h>
#include <vulkan/vulkan.h>
#include <vulkan/vk_layer.h>

static VkInstance instance;
static PFN_vkGetInstanceProcAddr next_instance;
static PFN_vkGetDeviceProcAddr next_device;

// The flags of a feature structure: they follow its sType and pNext.
#define FLAGS(structure, first, last) &(structure).first, (&(structure).last - &(structure).first) + 1
#define OF_1_0(f) FLAGS(f, robustBufferAccess, inheritedQueries)

static void claim(VkBool32 *flags, long count)
{
  for (long i = 0; i < count; i++) {
    flags[i] = VK_TRUE;
  }
}

static void limit(VkBool32 *asked, long count, const VkBool32 *there)
{
  for (long i = 0; i < count; i++) {
    asked[i] &= there[i];
  }
}

static void real_features(VkPhysicalDevice device, VkPhysicalDeviceFeatures2 *features)
{
  ((PFN_vkGetPhysicalDeviceFeatures2)next_instance(instance, "vkGetPhysicalDeviceFeatures2"))(device, features);
}

static VKAPI_ATTR void VKAPI_CALL features_of(VkPhysicalDevice device, VkPhysicalDeviceFeatures *features)
{
  (void)device;
  claim(OF_1_0(*features));
}

static VKAPI_ATTR void VKAPI_CALL features2_of(VkPhysicalDevice device, VkPhysicalDeviceFeatures2 *features)
{
  real_features(device, features);
  claim(OF_1_0(features->features));
  for (VkBaseOutStructure *each = features->pNext; each; each = each->pNext) {
    if (each->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_FEATURES) {
      ((VkPhysicalDeviceVulkan11Features *)each)->shaderDrawParameters = VK_TRUE;
    }
    if (each->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES) {
      VkPhysicalDeviceVulkan12Features *of_1_2 = (VkPhysicalDeviceVulkan12Features *)each;
      of_1_2->timelineSemaphore = of_1_2->bufferDeviceAddress = VK_TRUE;
      of_1_2->shaderOutputLayer = of_1_2->shaderOutputViewportIndex = VK_TRUE;
    }
  }
}

static VKAPI_ATTR VkResult VKAPI_CALL create_device(VkPhysicalDevice device,
                                                    const VkDeviceCreateInfo *asked,
                                                    const VkAllocationCallbacks *allocator,
                                                    VkDevice *result)
{
  VkLayerDeviceCreateInfo *link = (VkLayerDeviceCreateInfo *)asked->pNext;
  while (link->sType != VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO || link->function != VK_LAYER_LINK_INFO) {
    link = (VkLayerDeviceCreateInfo *)link->pNext;
  }
  PFN_vkGetInstanceProcAddr next = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
  next_device = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
  link->u.pLayerInfo = link->u.pLayerInfo->pNext;

  VkPhysicalDeviceVulkan12Features of_1_2 = {VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
  VkPhysicalDeviceVulkan11Features of_1_1 = {VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_FEATURES, &of_1_2};
  VkPhysicalDeviceFeatures2 there = {VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, &of_1_1};
  real_features(device, &there);
  if (asked->pEnabledFeatures) {
    limit(OF_1_0(*(VkPhysicalDeviceFeatures *)asked->pEnabledFeatures), &there.features.robustBufferAccess);
  }
  for (VkBaseOutStructure *each = (VkBaseOutStructure *)asked->pNext; each; each = each->pNext) {
    if (each->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2) {
      limit(OF_1_0(((VkPhysicalDeviceFeatures2 *)each)->features), &there.features.robustBufferAccess);
    }
    if (each->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_DRAW_PARAMETERS_FEATURES) {
      ((VkPhysicalDeviceShaderDrawParametersFeatures *)each)->shaderDrawParameters &= of_1_1.shaderDrawParameters;
    }
    if (each->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_FEATURES) {
      VkPhysicalDeviceVulkan11Features *features = (VkPhysicalDeviceVulkan11Features *)each;
      limit(FLAGS(*features, storageBuffer16BitAccess, shaderDrawParameters), &of_1_1.storageBuffer16BitAccess);
    }
    if (each->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES) {
      VkPhysicalDeviceVulkan12Features *features = (VkPhysicalDeviceVulkan12Features *)each;
      limit(FLAGS(*features, samplerMirrorClampToEdge, subgroupBroadcastDynamicId), &of_1_2.samplerMirrorClampToEdge);
    }
  }
  return ((PFN_vkCreateDevice)next(instance, "vkCreateDevice"))(device, asked, allocator, result);
}

static VKAPI_ATTR VkResult VKAPI_CALL create_instance(const VkInstanceCreateInfo *asked,
                                                      const VkAllocationCallbacks *allocator,
                                                      VkInstance *result)
{
  VkLayerInstanceCreateInfo *link = (VkLayerInstanceCreateInfo *)asked->pNext;
  while (link->sType != VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO || link->function != VK_LAYER_LINK_INFO) {
    link = (VkLayerInstanceCreateInfo *)link->pNext;
  }
  next_instance = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
  link->u.pLayerInfo = link->u.pLayerInfo->pNext;
  VkResult code = ((PFN_vkCreateInstance)next_instance(NULL, "vkCreateInstance"))(asked, allocator, result);
  instance = *result;
  return code;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_function(VkDevice device, const char *name)
{
  return strcmp(name, "vkGetDeviceProcAddr") == 0 ? (PFN_vkVoidFunction)device_function : next_device(device, name);
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_function(VkInstance of, const char *name)
{
  const struct {
    const char *name;
    PFN_vkVoidFunction function;
  } own[] = {
      {"vkGetInstanceProcAddr", (PFN_vkVoidFunction)instance_function},
      {"vkGetDeviceProcAddr", (PFN_vkVoidFunction)device_function},
      {"vkCreateInstance", (PFN_vkVoidFunction)create_instance},
      {"vkCreateDevice", (PFN_vkVoidFunction)create_device},
      {"vkGetPhysicalDeviceFeatures", (PFN_vkVoidFunction)features_of},
      {"vkGetPhysicalDeviceFeatures2", (PFN_vkVoidFunction)features2_of},
      {"vkGetPhysicalDeviceFeatures2KHR", (PFN_vkVoidFunction)features2_of},
  };
  for (size_t i = 0; i < sizeof(own) / sizeof(own[0]); i++) {
    if (strcmp(name, own[i].name) == 0) {
      return own[i].function;
    }
  }
  return next_instance ? next_instance(of, name) : NULL;
}

VKAPI_ATTR VkResult VKAPI_CALL vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface *versions)
{
  versions->loaderLayerInterfaceVersion = 2;
  versions->pfnGetInstanceProcAddr = instance_function;
  versions->pfnGetDeviceProcAddr = device_function;
  versions->pfnGetPhysicalDeviceProcAddr = NULL;
  return VK_SUCCESS;
}
