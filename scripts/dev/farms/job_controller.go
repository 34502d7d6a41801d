// SPDX-License-Identifier: GPL-3.0-or-later

// Lets the Job controller of Kubernetes do a Job in memory, for try_kubernetes.py:
//
//	job_controller MANIFEST CODES ...
//
// The Job has the defaults of Kubernetes, and passes the checks of its API server. CODES, as 3,3,0, are the exit codes of
// the pods of the Job's first part, one after another, the last one again and again; "evicted" stands for a pod that was
// evicted. All other parts end with 0, or with what is named after a slash, as 4/4. For each CODES it prints a line of words:
// how often the first part was started, how the Job ended, and why; how many parts were done; which ones failed.
package main

import (
	"context"
	"fmt"
	"os"
	"strconv"
	"strings"
	"sync"
	"time"

	batchv1 "k8s.io/api/batch/v1"
	corev1 "k8s.io/api/core/v1"
	metav1 "k8s.io/apimachinery/pkg/apis/meta/v1"
	"k8s.io/apimachinery/pkg/runtime"
	"k8s.io/apimachinery/pkg/types"
	"k8s.io/client-go/informers"
	"k8s.io/client-go/kubernetes/fake"
	clienttesting "k8s.io/client-go/testing"
	"k8s.io/kubernetes/pkg/apis/batch"
	batchdefaults "k8s.io/kubernetes/pkg/apis/batch/v1"
	"k8s.io/kubernetes/pkg/apis/batch/validation"
	controller "k8s.io/kubernetes/pkg/controller/job"
	"sigs.k8s.io/yaml"
)

const namespace = "default"

// read returns the Job of a manifest.
func read(path string) *batchv1.Job {
	text, err := os.ReadFile(path)
	must(err)
	job := &batchv1.Job{}
	must(yaml.UnmarshalStrict(text, job))
	job.Namespace, job.UID = namespace, "1"
	batchdefaults.SetObjectDefaults_Job(job)
	labels := map[string]string{"job": "1"} // which the API server would add
	job.Spec.Selector, job.Spec.Template.Labels = &metav1.LabelSelector{MatchLabels: labels}, labels
	checked, isManual := &batch.Job{}, true
	must(batchdefaults.Convert_v1_Job_To_batch_Job(job, checked, nil))
	checked.Spec.ManualSelector = &isManual
	if found := validation.ValidateJob(checked, validation.JobValidationOptions{}); len(found) > 0 {
		panic(found.ToAggregate())
	}
	return job
}

// run lets the controller do a Job, and prints what came of it.
func run(job *batchv1.Job, codes []string, others string) {
	ctx, cancel := context.WithCancel(context.Background())
	defer cancel()
	client := fake.NewClientset(job)
	var lock sync.Mutex
	pods, starts := 0, 0
	client.PrependReactor("create", "pods", func(action clienttesting.Action) (bool, runtime.Object, error) {
		lock.Lock()
		defer lock.Unlock()
		pods++
		pod := action.(clienttesting.CreateAction).GetObject().(*corev1.Pod)
		pod.Name, pod.UID = fmt.Sprintf("%s%d", pod.GenerateName, pods), types.UID(strconv.Itoa(pods))
		code := others
		if pod.Annotations[batchv1.JobCompletionIndexAnnotation] == "0" {
			code = codes[min(starts, len(codes)-1)]
			starts++
		}
		go end(ctx, client, pod.Name, code)
		return false, nil, nil
	})
	factory := informers.NewSharedInformerFactory(client, 0)
	jobs, err := controller.NewController(ctx, factory.Core().V1().Pods(), factory.Batch().V1().Jobs(), client)
	must(err)
	factory.Start(ctx.Done())
	factory.WaitForCacheSync(ctx.Done())
	go jobs.Run(ctx, 1)
	for {
		time.Sleep(100 * time.Millisecond)
		now, err := client.BatchV1().Jobs(namespace).Get(ctx, job.Name, metav1.GetOptions{})
		must(err)
		for _, found := range now.Status.Conditions {
			if found.Type == batchv1.JobComplete || found.Type == batchv1.JobFailed {
				failed := ""
				if now.Status.FailedIndexes != nil {
					failed = *now.Status.FailedIndexes
				}
				fmt.Println(starts, found.Type, found.Reason, now.Status.Succeeded, failed)
				return
			}
		}
	}
}

// end ends a pod as its node would.
func end(ctx context.Context, client *fake.Clientset, name string, code string) {
	time.Sleep(200 * time.Millisecond)
	pods := client.CoreV1().Pods(namespace)
	pod, err := pods.Get(ctx, name, metav1.GetOptions{})
	must(err)
	pod.Status.Phase = corev1.PodFailed
	if code == "0" {
		pod.Status.Phase = corev1.PodSucceeded
	}
	if code == "evicted" {
		code = "137"
		pod.Status.Conditions = []corev1.PodCondition{{Type: corev1.DisruptionTarget, Status: corev1.ConditionTrue}}
	}
	number, err := strconv.Atoi(code)
	must(err)
	now := metav1.Now()
	state := corev1.ContainerState{
		Terminated: &corev1.ContainerStateTerminated{ExitCode: int32(number), StartedAt: now, FinishedAt: now},
	}
	container := pod.Spec.Containers[0].Name
	pod.Status.ContainerStatuses = []corev1.ContainerStatus{{Name: container, State: state}}
	_, err = pods.UpdateStatus(ctx, pod, metav1.UpdateOptions{})
	must(err)
}

func must(err error) {
	if err != nil {
		panic(err)
	}
}

func main() {
	controller.DefaultJobPodFailureBackOff = 10 * time.Millisecond // not 10 seconds before the second try
	job := read(os.Args[1])
	for _, word := range os.Args[2:] {
		codes, others, isGiven := strings.Cut(word, "/")
		if !isGiven {
			others = "0"
		}
		run(job.DeepCopy(), strings.Split(codes, ","), others)
	}
}
